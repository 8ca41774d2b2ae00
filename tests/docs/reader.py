"""Somebody who follows a page: writes its files, makes its edits and runs its commands, in a folder of their own.

The folder holds what a checkout has for users (missions, manifests, examples). The commands run in a network namespace
of their own: no port collides with another test's, and nothing reaches any network.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from tests.docs.commands import Command, calls, commands, is_a_form
from tests.docs.pages import COMMANDS, ROOT, Block, blocks
from tests.docs.table import INSTEAD, NOT_RUN, STAYS, Stay, entry

CARRIED = ("missions", "manifests", "examples")
PATIENCE = 120.0
"""Seconds that a command has to end, and one that stays to come up."""
END_PATIENCE = 90.0
"""Seconds that a command which stays has to end after ctrl-C."""
_STATE = """\
cd "$(cat {state}/folder)" && . {state}/exported
(exit "$(cat {state}/code)")
{command}
code=$?
pwd > {state}/folder; export -p > {state}/exported; echo $code > {state}/code
exit $code
"""
_VARYING = re.compile(r"\d\d:\d\d:\d\d(?:\.\d+)?|\d+\.\d+")
_DEFECT = re.compile(r"^Traceback|defect in (?:argosy|agentd|bridged|commd)", re.MULTILINE)


class StumbledError(AssertionError):
    """The page says something that is not so."""


class Reader:
    """Follows pages; what was left running is interrupted at the end, and has to end."""

    def __init__(self, folder: Path, within: Sequence[str] = ()) -> None:
        """``within`` stands before each command, such as `ip netns exec NAME`."""
        self._folder, self._within = folder / "argosy", tuple(within)
        self._state = folder / "state"
        self._staying: list[tuple[Command, Stay, subprocess.Popen[bytes], Path]] = []
        self._state.mkdir()
        for name in CARRIED:
            shutil.copytree(ROOT / name, self._folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        (self._state / "folder").write_text(str(self._folder))
        (self._state / "exported").write_text("")
        (self._state / "code").write_text("0")
        home = folder / "home"
        (runs := home / "run").mkdir(parents=True, mode=0o700)
        self._environment = {
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
            "HOME": str(home),
            "XDG_STATE_HOME": str(home / "state"),
            "XDG_RUNTIME_DIR": str(runs),  # a run of another page that starts now is on another network
            "LANG": "C.UTF-8",
            "NO_COLOR": "1",
            "COLUMNS": "120",
            "TERM": "dumb",
        }

    def __enter__(self) -> Reader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for _, _, process, _ in self._staying:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait(10)

    def follow(self, page: str) -> None:
        """Do what a page says, to its end. Raises StumbledError."""
        for block in blocks(page):
            if block.language in COMMANDS:
                todo = commands(block)
                for number, command in enumerate(todo):
                    self._do(command, code_is_read="$?" in "".join(one.text for one in todo[number + 1 : number + 2]))
            elif block.language == "diff":
                self._edit(block)
            elif block.title:
                self._write(block)
        self._leave()

    def _write(self, block: Block) -> None:
        path = self._folder / block.title
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.text, encoding="utf-8")

    def _edit(self, block: Block) -> None:
        path, lines = self._folder / block.title, block.text.splitlines(keepends=True)
        old, new = ("".join(line[1:] for line in lines if line[0] in signs) for signs in (" -", " +"))
        text = path.read_text(encoding="utf-8")
        if text.count(old) != 1:
            raise StumbledError(f"{block.where}: {text.count(old)} places in {block.title} read so:\n{old}")
        path.write_text(text.replace(old, new), encoding="utf-8")

    def _do(self, command: Command, code_is_read: bool) -> None:
        if is_a_form(command.text) or entry(NOT_RUN, command.page, command.text) is not None:
            return
        if stay := entry(STAYS, command.page, command.text):
            self._stay(command, stay)
            return
        output = self._state / "output"
        process = self._start(_STATE.format(state=self._state, command=_to_run(command)), output)
        try:
            code = process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            raise StumbledError(f"{_reported(command, output)}\nit has not ended after {PATIENCE:g} s") from None
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        if code and not code_is_read:
            raise StumbledError(f"{_reported(command, output)}\nexit code {code}")
        _compare(command, output)
        self._leave(after=command.text)

    def _stay(self, command: Command, stay: Stay) -> None:
        output = self._state / f"output{command.line}"
        folder = (self._state / "folder").read_text().strip()
        script = f'cd "{folder}" && . {self._state}/exported && {_to_run(command)}'
        process = self._start(script, output)
        self._staying.append((command, stay, process, output))
        end = time.monotonic() + PATIENCE
        while stay.says not in output.read_text(errors="replace"):
            if process.poll() is not None or time.monotonic() > end:
                raise StumbledError(
                    f"{_reported(command, output)}\nit does not say `{stay.says}`; exit {process.poll()}"
                )
            time.sleep(0.05)

    def _leave(self, after: str | None = None) -> None:
        """End what stays, the last first, as a reader would: all of it, or what is to end after a command."""
        for one in self._staying[::-1]:
            command, stay, process, output = one
            if after is not None and not (stay.after and after.startswith(stay.after)):
                continue
            self._staying.remove(one)
            interrupted = stay.ends == "interrupt"
            if interrupted:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGINT)
            try:
                code = process.wait(END_PATIENCE if interrupted else PATIENCE)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                raise StumbledError(f"{_reported(command, output)}\nit does not end") from None
            if code not in {"interrupt": (0, 130, -signal.SIGINT), "itself": (0,), "failed": (1,)}[stay.ends]:
                raise StumbledError(f"{_reported(command, output)}\nexit code {code}")
            _compare(command, output)

    def _start(self, script: str, output: Path) -> subprocess.Popen[bytes]:
        with output.open("wb") as written:
            return subprocess.Popen(
                [*self._within, "bash", "-c", script],
                stdin=subprocess.DEVNULL,
                stdout=written,
                stderr=subprocess.STDOUT,
                env=self._environment,
                cwd=self._folder,
                start_new_session=True,
            )


def _to_run(command: Command) -> str:
    return entry(INSTEAD, command.page, command.text) or command.text


def _reported(command: Command, output: Path) -> str:
    return f"{command.where}: $ {_to_run(command)}\n{output.read_text(errors='replace')}"


def _compare(command: Command, output: Path) -> None:
    printed = output.read_text(errors="replace")
    if any(True for _ in calls(_to_run(command))) and _DEFECT.search(printed):
        raise StumbledError(f"{_reported(command, output)}\na defect")
    if command.output is not None and not shows(command.output, printed):
        raise StumbledError(f"{_reported(command, output)}\nbut the page shows\n" + "\n".join(command.output))


def shows(expected: Sequence[str], printed: str) -> bool:
    """Whether a command printed what a page shows of it: `...` is any text, and alone in a line any lines.

    Lines may begin with more or less space: figures are set flush right.
    """
    pattern = "".join("(?:.*\n)*?" if line.strip() == "..." else f"{_line(line.strip())}\n" for line in expected)
    lines = [line.strip() for line in printed.strip().splitlines()]
    return re.fullmatch(pattern, "".join(f"{line}\n" for line in lines)) is not None


def _line(line: str) -> str:
    texts = _VARYING.sub("\0", line).split("\0")
    varying = [r"\d\d:\d\d:\d\d(?:\.\d+)?" if ":" in one else r"\d+\.\d+" for one in _VARYING.findall(line)]
    pattern = re.escape(texts[0])
    for figure, text in zip(varying, texts[1:], strict=True):
        pattern += figure + re.escape(text)
    return pattern.replace(re.escape("..."), ".*")
