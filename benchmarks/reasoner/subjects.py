"""Those who are compared: how each of them is started."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import itertools
import os
import shutil
import subprocess
import sys
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

Agents = list[tuple[str, Path]]
_projects = itertools.count(1)

DECISIONS: Final = 200
"""So many decisions are remembered where records are on: the default of ``agentd serve``."""

PERCEPT_ROUNDS: Final = 10
PERCEPT_CYCLES: Final = 20_000
"""What the percept row runs: so many rounds of so many replaced percepts."""


class Subject(ABC):
    """One reasoner, or one way of running it."""

    key: str
    title: str

    @abstractmethod
    def command(self, agents: Agents, environment: str = "") -> list[str]:
        """The command that runs these agents; ``environment`` names the one that feeds percepts, if any."""

    @contextmanager
    def prepared(self, agents: Agents, environment: str = "") -> Iterator[list[str]]:
        """The command, for as long as the files that it needs are there."""
        yield self.command(agents, environment)


class Agentd(Subject):
    """``agentd run``, with decision records off as it is by default, or on as in ``agentd serve``."""

    def __init__(self, decisions: int = 0) -> None:
        self.key = "agentd --decisions" if decisions else "agentd"
        self.title = f"agentd, {decisions} decisions recorded" if decisions else "agentd"
        self._decisions = str(decisions)

    def command(self, agents: Agents, environment: str = "") -> list[str]:
        rounds, cycles = str(PERCEPT_ROUNDS), str(PERCEPT_CYCLES)
        if environment and ":" not in environment:
            return [sys.executable, "-m", environment, rounds, cycles, self._decisions, str(agents[0][1])]
        env = ["--env", environment, "--env-arg", rounds, "--env-arg", cycles] if environment else []
        named = [f"{name}={path}" for name, path in agents]
        return [sys.executable, "-m", "agentd", "run", "--decisions", self._decisions, *env, *named]


class AgentSpeak(Subject):
    """python-agentspeak, driven by `benchmarks.reasoner.agentspeak_driver`."""

    key = "agentspeak"
    title = "python-agentspeak"

    def command(self, agents: Agents, environment: str = "") -> list[str]:
        named = [f"{name}={path}" for name, path in agents]
        percepts = ["--percepts", f"{PERCEPT_ROUNDS},{PERCEPT_CYCLES}"] if environment else []
        return [sys.executable, "-m", "benchmarks.reasoner.agentspeak_driver", *percepts, *named]


class JasonCommand(Subject):
    """Jason itself, where a ``jason`` command is on PATH, on a project written for the row.

    ``jason mas start --mas2j=FILE`` runs a project as it stands (Jason 3.x, doc/jason-cli/commands.adoc in
    its repository): ``jason FILE.mas2j`` would make a Gradle project of it, and download. The percept rows are left
    out: their environment would have to be written in Java.
    """

    key = "jason"
    title = "Jason"

    def __init__(self, executable: str) -> None:
        self._executable = executable

    def command(self, agents: Agents, environment: str = "") -> list[str]:
        raise NotImplementedError("a project file is needed: use `prepared`")

    @contextmanager
    def prepared(self, agents: Agents, environment: str = "") -> Iterator[list[str]]:
        with tempfile.TemporaryDirectory() as folder:
            for _, path in agents:
                shutil.copy(path, folder)
            listed = " ".join(f"{name} {path.name};" for name, path in agents)
            name = f"bench_{os.getpid()}_{next(_projects)}"  # no two of a machine may have the same
            project = Path(folder, "bench.mas2j")
            project.write_text(f'MAS {name} {{ agents: {listed} aslSourcePath: "."; }}\n', encoding="utf-8")
            start = [self._executable, "mas", "start", "--console", "--no-net", f"--mas2j={project.name}"]
            yield ["/bin/sh", "-c", 'cd "$0" && exec "$@"', folder, *start]

    def version(self) -> str:
        """What it says of itself in one line, if it does so in time."""
        try:
            said = subprocess.run(
                [self._executable, "--version"], capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=30
            ).stdout.split("\n")[0]
        except (OSError, subprocess.TimeoutExpired):
            said = ""
        return said.strip() or "which does not tell its version"


def subjects_here() -> list[Subject]:
    """Those that can be run on this machine; agentd is the first of them."""
    found: list[Subject] = [Agentd(), Agentd(DECISIONS)]
    if importlib.util.find_spec("agentspeak") is not None:
        found.append(AgentSpeak())
    executable = shutil.which("jason")
    if executable is not None:
        found.append(JasonCommand(executable))
    return found
