"""The commands of `agentd` in a folder of their own."""

import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import pytest

from agentd.__main__ import main
from tests.agentd.hosts import Board, on_a_board
from tests.support import forked
from tests.support.buses import Connect


@dataclass
class Ran:
    """What a command has said."""

    code: int
    out: str
    err: str

    @property
    def lines(self) -> list[str]:
        """The lines of standard output."""
        return self.out.splitlines()


Command: TypeAlias = Callable[..., Ran]


def write(folder: Path, files: dict[str, str]) -> None:
    """Write files by name, with the folders that they need."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def agentd(
    *arguments: object, cwd: Path | None = None, env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command of `agentd` in a process of its own; with an environment, in a Python of its own."""
    if env is None:
        return forked.run(["agentd", *map(str, arguments)], timeout=120, cwd=cwd)
    command = [sys.executable, "-m", "agentd", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, cwd=cwd, env=env)


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Write files, then run a command of `agentd` in their folder and in this process."""
    monkeypatch.chdir(tmp_path)

    def command(files: dict[str, str], *arguments: str) -> Ran:
        write(tmp_path, files)
        capsys.readouterr()
        return Ran(main([*arguments]), *capsys.readouterr())

    return command


@pytest.fixture
def board(connect: AbstractAsyncContextManager[Connect], tmp_path: Path) -> AbstractAsyncContextManager[Board]:
    """Begin agents with `board.host`, on a bus with a router at `endpoint`."""
    return on_a_board(connect, tmp_path)
