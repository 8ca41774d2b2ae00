"""A real terminal for a command: a pty, and an emulator that knows what stands on the screen."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import signal
import struct
import sys
import termios
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import TracebackType

import pyte


class Terminal:
    """Runs `python -m ARGUMENTS`, or the script that the first argument names, in a terminal of some size."""

    def __init__(self, arguments: Sequence[str], columns: int = 80, lines: int = 24, **environment: str) -> None:
        self.screen = pyte.Screen(columns, lines)
        self.output = b""
        self._stream = pyte.ByteStream(self.screen)
        self.pid, self._pty = pty.fork()
        if self.pid == 0:
            plain = {
                name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "COLORTERM", "LINES")
            }
            everything = {**plain, "TERM": "xterm-256color", "LC_ALL": "C.UTF-8", **environment}
            everything.pop("COLUMNS", None)
            how = () if arguments[0].endswith(".py") else ("-m",)
            os.execve(sys.executable, [sys.executable, *how, *arguments], everything)
        self.size(columns, lines)

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
        self._close()

    def size(self, columns: int, lines: int) -> None:
        """Resize the window, which is empty until the command draws it for the new size."""
        self.screen.resize(lines, columns)
        self.screen.erase_in_display(2)
        fcntl.ioctl(self._pty, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))

    def press(self, keys: str) -> None:
        """Type."""
        os.write(self._pty, keys.encode())

    @property
    def text(self) -> str:
        """What stands on the screen."""
        return "\n".join(line.rstrip() for line in self.screen.display)

    def until(self, condition: Callable[[str], bool], wish: str, seconds: float = 120) -> None:
        """Read until the screen fulfils a condition."""
        end = time.monotonic() + seconds
        while not condition(self.text):
            assert time.monotonic() < end, f"not within {seconds:g} s: {wish}\n{self.text}"
            assert self._read(), f"it ended before {wish}\n{self.text}\n{self.output[-2000:]!r}"

    def shows(self, words: str, seconds: float = 120) -> None:
        """Read until the screen has these words."""
        self.until(lambda text: words in text, words, seconds)

    def end(self, seconds: float = 90) -> int:
        """Read until the command has ended. Returns its exit code."""
        end = time.monotonic() + seconds
        while self._read():
            assert time.monotonic() < end, f"it does not end within {seconds:g} s\n{self.text}"
        return self._exit_code()

    def hang_up(self) -> int:
        """Close the terminal's window and wait for the command's end. Returns its exit code."""
        self._close()
        return self._exit_code()

    def _close(self) -> None:
        if self._pty >= 0:
            os.close(self._pty)
            self._pty = -1

    def _exit_code(self) -> int:
        _, status = os.waitpid(self.pid, 0)
        return os.waitstatus_to_exitcode(status)

    def _read(self) -> bool:
        readable, _, _ = select.select([self._pty], [], [], 0.2)
        if not readable:
            return True
        try:
            data = os.read(self._pty, 65_536)
        except OSError:
            return False
        self.output += data
        self._stream.feed(data)
        return bool(data)
