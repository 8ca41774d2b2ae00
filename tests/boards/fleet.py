"""A mission on boards of a network: daemons are started, killed and started again, each in its board's namespace."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from schemas.mission.model import Mission, load_mission
from tests.boards.network import GROUND, Network
from tests.support.processes import ROOT, Daemon, poll

Kind = Literal["commd", "bridged", "agentd"]
LOOK_PATIENCE = 90.0
"""Seconds that a look has to begin or to answer; its own questions last 3 s at most."""
_READY = {"commd": "router board=", "bridged": "serving ", "agentd": "agents="}


class Fleet:
    """The daemons of a mission. What is on a board's disk stays there when they die: `state/BOARD`."""

    def __init__(self, network: Network, mission: Path, state: Path) -> None:
        self.network, self.path, self.state = network, mission, state
        self.mission: Mission = load_mission(mission)
        self.running: dict[tuple[str, Kind], Daemon] = {}
        self.printed: dict[tuple[str, Kind], list[str]] = {}
        """The lines of earlier lives."""
        self._others: list[Daemon] = []
        self._looks: dict[str, Look] = {}

    def __enter__(self) -> Fleet:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for look in self._looks.values():
            look.close()
        for daemon in (*self.running.values(), *self._others):
            daemon.kill()

    @property
    def boards(self) -> list[str]:
        return list(self.mission.boards)

    def kinds(self, board: str) -> list[Kind]:
        """Return the daemons that a board has, in the order in which they start."""
        robots = any(robot.board == board for robot in self.mission.robots.values())
        agents = any(agent.board == board for agent in self.mission.agents.values())
        return ["commd", *(["bridged"] if robots else []), *(["agentd"] if agents else [])]  # type: ignore[list-item]

    def start(self, board: str, kind: Kind, *options: str) -> Daemon:
        """Start a daemon of a board, and return at once."""
        old = self.running.get((board, kind))
        assert old is None or old.process.poll() is not None, f"{kind} of {board} is running already"
        if old is not None:
            self.printed.setdefault((board, kind), []).extend(old.lines)
        arguments = (kind, "serve", str(self.path), "--board", board, "--state", str(self.state / board), *options)
        daemon = Daemon(*arguments, within=self.network.within(board))
        self.running[board, kind] = daemon
        return daemon

    def up(self, *boards: str) -> None:
        """Start all daemons of these boards, of all by default, and wait until they say that they serve."""
        names = boards or tuple(self.boards)
        for board in names:
            for kind in self.kinds(board):
                self.start(board, kind)
        for board in names:
            for kind in self.kinds(board):
                self.ready(board, kind)

    def ready(self, board: str, kind: Kind) -> Daemon:
        """Wait until a daemon says that it serves."""
        daemon = self.running[board, kind]
        daemon.says(_READY[kind], 60)
        return daemon

    def kill(self, board: str, *kinds: Kind) -> None:
        """Kill -9 these daemons of a board, all of them by default, and wait until they are gone."""
        for kind in kinds or tuple(self.kinds(board)):
            self.running[board, kind].kill()

    def text(self, board: str, kind: Kind) -> str:
        """Return what a daemon has said in all of its lives."""
        return "\n".join([*self.printed.get((board, kind), []), *self.running[board, kind].lines])

    def transcript(self) -> str:
        """Return what all processes have said, each under its name."""
        texts = [f"--- {kind} of {board}\n{self.text(board, kind)}" for board, kind in self.running]
        return "\n".join([*texts, *(f"--- {' '.join(other.arguments)}\n{other.text}" for other in self._others)])

    def ground(self, *arguments: str) -> Daemon:
        """Start a process on the ground: simulators, mostly."""
        self._others.append(Daemon(*arguments, within=self.network.within(GROUND)))
        return self._others[-1]

    def look(self, board: str) -> Look:
        """Return a look at the bus from a board; its router must be there."""
        if board not in self._looks:
            self._looks[board] = Look(self.network.within(board), self.mission)
        return self._looks[board]


class Look:
    """A process on a board that tells what is on the bus there (`tests.boards.look`)."""

    def __init__(self, within: tuple[str, ...], mission: Mission) -> None:
        command = [*within, sys.executable, "-m", "tests.boards.look", mission.fleet, mission.router.endpoint]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, cwd=ROOT, start_new_session=True)
        self._answers: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def close(self) -> None:
        self._process.kill()
        self._process.wait(10)

    def mind(self, agent: str) -> list[str] | None:
        """Return the beliefs of an agent; None if it does not answer."""
        found: list[str] | None = self._ask("mind", agent)
        return found

    def alive(self) -> list[str]:
        """Return `NAME/DAEMON` of every token that is there."""
        return sorted({"/".join(key.split("/")[2:5:2]) for key in self._ask("alive") or ()})

    def boxes(self) -> dict[str, Any]:
        """Return what waits at every `commd` that answers, as plain data by board."""
        found: dict[str, Any] = self._ask("boxes") or {}
        return found

    def until(self, condition: Callable[[Look], object], wish: str, seconds: float = 60) -> float:
        """Ask until something holds; return the seconds that it took."""
        return poll(lambda: condition(self), wish, seconds)

    def believes(self, agent: str, belief: str, seconds: float = 60) -> float:
        """Wait until an agent believes something that is written so, annotations aside."""

        def held(look: Look) -> bool:
            return any(one == belief or one.startswith(f"{belief}[") for one in look.mind(agent) or ())

        return self.until(held, f"{agent} believes {belief}; it believes {self.mind(agent)}", seconds)

    def _ask(self, *question: str) -> Any:
        self._process.stdin.write(json.dumps(question) + "\n")
        self._process.stdin.flush()
        try:
            return json.loads(self._answers.get(timeout=LOOK_PATIENCE))
        except queue.Empty:
            raise AssertionError(f"no answer to {question} within {LOOK_PATIENCE:g} s") from None

    def _read(self) -> None:
        for line in self._process.stdout:
            self._answers.put(line)
