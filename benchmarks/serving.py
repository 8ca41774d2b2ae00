"""Start the daemons of a board for a mission in a folder, and a bare process with a Zenoh session beside them."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from argosy.processes.process_table import python_command
from benchmarks.processes import SPEAKS, Watched, watched, watched_command
from benchmarks.results import ROOT
from tests.support.ports import free_port

CODE: Final = ("schemas", "commd", "bridged", "agentd", "argosy", "missions", "manifests")
FIRST: Final = "the first plan runs"
"""What the first plan prints."""
_PROGRAM: Final = f"""
{{ include("uav.asl") }}
!begun.
+!begun <- .print("{FIRST}").
"""
_BARE: Final = """
import sys, time, zenoh
for module in sys.argv[3:]:
    __import__(module, fromlist=["*"])
config = zenoh.Config()
config.insert_json5("mode", '"%s"' % sys.argv[1])
config.insert_json5({"client": "connect", "router": "listen"}[sys.argv[1]] + "/endpoints", '["%s"]' % sys.argv[2])
config.insert_json5("scouting/multicast/enabled", "false")
session = zenoh.open(config)
print("open", flush=True)
time.sleep(3600)
"""
CLIENT: Final = """
import asyncio, sys
from commd.client import join
async def main():
    async with join("looker", mission=sys.argv[2], router=sys.argv[1]) as me:
        percepts = me.percepts("uav")
        print("joined", flush=True)
        await asyncio.Event().wait()
asyncio.run(main())
"""
"""A program of the team that perceives what the agent perceives."""


def bare(endpoint: str, *modules: str, mode: Literal["client", "router"] = "client") -> tuple[str, ...]:
    """Return the arguments of a Python that has a session with a router and nothing besides; it prints `open`.

    The modules are imported as well: a daemon that is held against it may be excused for them. As `router` it is one
    itself, and listens at the endpoint.
    """
    return ("-c", _BARE, mode, endpoint, *modules)


SERVES: Final = {
    "bare": "open",
    "commd": "router board=",
    "bridged": "serving uav1",
    "agentd": FIRST,
    "client": "joined",
    "board": FIRST,
}
"""What each kind of process prints when it serves."""
NAMES: Final = {
    "bare": "a bare process with a session",
    "commd": "`commd serve`",
    "bridged": "`bridged serve`",
    "agentd": "`agentd serve`",
    "client": "a program on `commd.client`",
    "board": "`argosy board`: those three in one",
}
"""As people read it."""


READY: Final = {"commd": "router board=", "simulator": "simulated", "bridged": "serving", "agentd": "agents="}
"""What each kind of process prints when it is there."""


@dataclass(frozen=True)
class Site:
    """A mission in a folder, and the router that it is run on."""

    mission: Path
    router: str
    state: Path

    @classmethod
    def written(cls, folder: Path, mission: str, **programs: str) -> Site:
        """Write a mission's text into a folder, with a router of its own, and its programs by their names."""
        router = f"tcp/127.0.0.1:{free_port()}"
        file = folder / "mission.yaml"
        file.write_text(f"{mission}\nrouter: {{endpoint: {router}}}\n")
        for name, program in programs.items():
            (folder / f"{name}.asl").write_text(program)
        return cls(file, router, folder / "state")

    def serve(self, stack: ExitStack, name: str, *more: str, ready: str = "", patience: float = SPEAKS) -> Watched:
        """Run a daemon until the stack ends. Returns when it serves, or prints `ready`.

        Raises BenchmarkFailed when it has not after `patience` seconds.
        """
        command = ("-m", name, "serve", str(self.mission), *more, "--state", str(self.state / name))
        found = stack.enter_context(watched(name, *command))
        found.wait_for(ready or READY[name], patience)
        return found

    @classmethod
    def made(cls, folder: Path, code: Path = ROOT) -> Site:
        """Write the paper's first mission into a folder, with ports of its own, but without a vehicle.

        The bridge serves and waits for it, the agent's own goals wait for the bridge: nothing flies.
        """
        source = code / "missions"
        (folder / "single_uav").mkdir(parents=True)
        (folder / "single_uav" / "uav.asl").write_text((source / "single_uav" / "uav.asl").read_text())
        (folder / "single_uav" / "begun.asl").write_text(_PROGRAM)
        text = (source / "single_uav.yaml").read_text()
        text = text.replace("uav.asl", "begun.asl").replace("127.0.0.1:14550", f"127.0.0.1:{free_port()}")
        (folder / "mission.yaml").write_text(text)
        return cls(folder / "mission.yaml", f"tcp/127.0.0.1:{free_port()}", folder / "state")

    def arguments(self, name: str) -> tuple[str, ...]:
        """Return what a process of a kind is called with, behind the interpreter and its options."""
        mission, where, state = str(self.mission), ("--router", self.router), ("--state", str(self.state / name))
        match name:
            case "bare":
                return bare(self.router)
            case "client":
                return ("-c", CLIENT, self.router, mission)
            case "board":
                return ("-m", "argosy", "board", mission, "--board", "local", *where, *state, "--simulated", "--fresh")
            case "commd":
                return ("-m", "commd", "serve", mission, "--board", "local", *where, *state)
            case "bridged":
                return ("-m", "bridged", "serve", mission, *where, *state, "--simulated")
        return ("-m", "agentd", "serve", mission, *where, *state, "--fresh")

    def command(self, name: str) -> list[str]:
        """Return the command line of a process of a kind."""
        return [*python_command()[:-1], *self.arguments(name)]


@contextmanager
def serving(site: Site, name: str, before: tuple[str, ...] = ()) -> Iterator[Watched]:
    """Run a process of a kind while the block lasts, from the moment on at which it serves. Raises BenchmarkFailed.

    `before` is put before its command.
    """
    with watched_command(name, [*before, *site.command(name)]) as found:
        found.wait_for(SERVES[name])
        yield found


def copied(folder: Path, *, compiled: bool) -> Path:
    """Copy the code into a folder, with its byte code or without any. Returns where it is.

    What byte code there is already is copied with the times of its files, by which Python knows whether it is right.
    """
    left = ("*.pyc.*",) if compiled else ("__pycache__",)  # another process may be writing the former
    for name in CODE:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns(*left))
    if compiled:
        subprocess.run([sys.executable, "-m", "compileall", "-q", str(folder)], check=True)
    return folder


def environment(code: Path) -> tuple[str, ...]:
    """Return the prefix of a command that runs the code of a folder without changing it."""
    return ("env", f"PYTHONPATH={code}", "PYTHONDONTWRITEBYTECODE=1")
