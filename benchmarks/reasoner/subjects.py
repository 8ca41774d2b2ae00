"""The reasoners that are compared, and how each of them is started."""

from __future__ import annotations

import importlib.util
import sys
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Final

Agents = list[tuple[str, Path]]

DECISIONS: Final = 200
"""Decisions that are remembered where records are on: the default of ``agentd serve``."""

PERCEPT_ROUNDS: Final = 10
PERCEPT_CYCLES: Final = 20_000
"""Rounds of the percept row, and replaced percepts in each."""


class Subject(ABC):
    """One reasoner, or one way of running it."""

    key: str
    title: str

    @abstractmethod
    def command(self, agents: Agents, environment: str = "") -> list[str]:
        """Return the command that runs these agents; ``environment`` names the one that feeds percepts, if any."""


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


def subjects_here() -> list[Subject]:
    """Return those that can be run on this machine; agentd is the first of them."""
    peers = [AgentSpeak()] if importlib.util.find_spec("agentspeak") is not None else []
    return [Agentd(), Agentd(DECISIONS), *peers]
