"""Running `argosy` as a user does: a process of its own, with or without a terminal."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.support.forked import Forked
from tests.support.processes import PATIENCE, poll

MISSIONS = Path(__file__).parents[2] / "missions"
DOUBLES = Path(__file__).with_name("doubles.py")


class Running:
    """An `argosy run` under way. Reads what it prints into files, so that it never waits for the test."""

    def __init__(
        self, start: type[subprocess.Popen[Any]], command: list[str], folder: Path, environment: dict[str, str]
    ) -> None:
        self._out, self._err, self._cue = folder / "stdout", folder / "stderr", folder / "cue"
        with self._out.open("wb") as out, self._err.open("wb") as err:
            self.process = start(
                command,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                env={**os.environ, **environment, "CUE": str(self._cue)},
                start_new_session=True,
            )
        self.family: dict[str, psutil.Process] = {}

    @property
    def stdout(self) -> str:
        return self._out.read_text()

    @property
    def stderr(self) -> str:
        return self._err.read_text()

    def give_cue(self) -> None:
        """Now is when the stand-in with a fault shows it."""
        self._cue.touch()

    def until(self, text: str, seconds: float = PATIENCE) -> None:
        """Wait until it has printed a text, and remember the processes that it has then."""
        self.until_true(lambda: text in self.stdout, repr(text), seconds)
        self.remember()

    def until_true(self, condition: Callable[[], bool], wish: str, seconds: float = PATIENCE) -> None:
        """Wait until something holds of a run that goes on."""
        poll(condition, wish, seconds, said=lambda: self.stdout + self.stderr, process=self.process)

    def remember(self) -> None:
        """Note the processes that it has now, by kind."""
        with suppress(psutil.Error):
            for child in psutil.Process(self.process.pid).children(recursive=True):
                with suppress(psutil.Error):  # it may end while we look
                    self._note(child, " ".join(child.cmdline()))

    def _note(self, child: psutil.Process, line: str) -> None:
        for kind in ("commd serve", "bridged simulate", "bridged serve", "agentd serve"):
            if kind in line:
                self.family[kind] = child
        for word, kind in {"simulator": "simulate", "bridged": "serve"}.items():
            if f"-m doubles {word}" in line:
                self.family[f"bridged {kind}"] = child
        if "-m doubles agentd" in line:
            self.family["agentd serve"] = child
        self.family.setdefault(line, child)

    def wait(self, seconds: float = 120) -> int:
        """Wait for its end. Returns the exit code."""
        return self.process.wait(seconds)

    def left_running(self) -> list[str]:
        """Return the command lines of remembered processes that do not end."""
        with suppress(AssertionError):
            poll(lambda: not self._left(), "all end")
        return [" ".join(one.cmdline()) for one in self._left()]

    def _left(self) -> list[psutil.Process]:
        left = []
        for one in self.family.values():
            with suppress(psutil.NoSuchProcess):
                left += [one] * (one.is_running() and one.status() != psutil.STATUS_ZOMBIE)
        return left

    def end(self) -> None:
        """Kill whatever is left."""
        if self.process.poll() is None:
            self.remember()
            self.process.send_signal(signal.SIGKILL)
            self.process.wait(10)
        for one in self.family.values():
            if one.is_running():
                one.kill()


Start = Callable[..., Running]


@contextmanager
def starting(tmp_path: Path, endpoint: str) -> Iterator[Start]:
    """Give a function that starts `argosy run ARGS...`, with stand-ins for the daemons unless `real_daemons`."""
    started: list[Running] = []

    def begin(mission: Path, *arguments: str, fault: str = "", real_daemons: bool = False) -> Running:
        program = ["argosy"] if real_daemons else [sys.executable, str(DOUBLES)]
        folder = tmp_path / f"run{len(started)}"
        folder.mkdir()
        command = [*program, "run", str(mission), "--router", endpoint, *arguments]
        how = Forked if real_daemons else subprocess.Popen
        started.append(Running(how, command, folder, {"FAULT": fault}))
        return started[-1]

    try:
        yield begin
    finally:
        for running in started:
            running.end()


@pytest.fixture
def start(tmp_path: Path, endpoint: str) -> Iterator[Start]:
    """Return what starts an `argosy run` that ends with the test."""
    with starting(tmp_path, endpoint) as begin:
        yield begin


def copied(name: str, folder: Path, port: int) -> Path:
    """Copy a shipped mission, with its programs where they are, to a link port of its own."""
    text = (MISSIONS / f"{name}.yaml").read_text()
    text = text.replace("udpin:127.0.0.1:14550", f"udpin:127.0.0.1:{port}")
    path = folder / f"{name}.yaml"
    path.write_text(text.replace(f"program: {name}/", f"program: {MISSIONS / name}/"))
    return path


@pytest.fixture
def single_uav(tmp_path: Path, free_port: Callable[[], int]) -> Path:
    """Return a copy of the first mission whose vehicle has a link port of its own."""
    return copied("single_uav", tmp_path, free_port())


@pytest.fixture
def three_uavs(tmp_path: Path, free_port: Callable[[], int]) -> Path:
    """Return a copy of the mission of three copters, on a link port of their own."""
    return copied("three_uavs", tmp_path, free_port())
