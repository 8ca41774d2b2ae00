"""Processes of Argosy for tests, forked from one that has imported the command: a start takes a tenth to a fifth.

`Forked(["agentd", "run", ...])` is a `subprocess.Popen` of `python -m agentd run ...`, with a process id, session,
folder, environment and files of its own; `run` is `subprocess.run`. What tests the start itself, imports, memory, a
terminal, or a variable that Python reads at its start (but `PYTHONPATH`) takes `subprocess`.

Their parent is this module as a program, one for each process of pytest: it has no threads, and imports what a command
needs before it forks the first process for it. It ends with that process of pytest, and they with it.
"""

import gc
import json
import os
import runpy
import select
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import cache
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

from argosy.processes.launcher import end_with_parent

ROOT = Path(__file__).parents[2]
PROGRAMS = ("agentd", "argosy", "bridged", "commd")
LARGEST = 200_000
"""Bytes of arguments and environment of a process."""
_NUMBER = struct.Struct("i")
_OPTIONS = tuple(signature(subprocess.Popen._execute_child).parameters)[1:]  # type: ignore[attr-defined]
_LATER = ("agentd.extensions.plugins",)
"""Modules that commands import only when they run."""


class Forked(subprocess.Popen[Any]):
    """A process that runs `python -m ARGUMENTS`; takes a Popen's options for files, text, folder and environment."""

    def __init__(self, arguments: Sequence[str | Path], **options: Any) -> None:
        super().__init__([str(one) for one in arguments], **options)

    def _execute_child(self, *given: Any) -> None:
        """Let the parent fork, where a Popen forks and executes."""
        options = dict(zip(_OPTIONS, given, strict=True))
        request = {
            "arguments": options["args"],
            "environment": dict(os.environ if options["env"] is None else options["env"]),
            "folder": str(Path.cwd() if options["cwd"] is None else options["cwd"]),
        }
        ends = (options["p2cread"], options["c2pwrite"], options["errwrite"])
        files = [number if end == -1 else end for number, end in enumerate(ends)]
        self._status, status = socket.socketpair()
        with status:
            socket.send_fds(_parent(), [json.dumps(request).encode()], [*files, status.fileno()])
        self.pid = _NUMBER.unpack(self._status.recv(_NUMBER.size))[0]
        self._child_created = True
        self._close_pipe_fds(*(options[name] for name in _OPTIONS if name.endswith(("read", "write"))))

    def _try_wait(self, flags: int) -> tuple[int, int]:
        """Stand in for `os.waitpid`: the parent tells how the process has ended."""
        try:
            status = self._status.recv(_NUMBER.size, socket.MSG_DONTWAIT if flags & os.WNOHANG else 0)
        except BlockingIOError:
            return 0, 0
        self._status.close()
        if not status:
            raise OSError("the parent of the forked processes has ended")
        return self.pid, _NUMBER.unpack(status)[0]

    def _internal_poll(self, *_: Any, **__: Any) -> int | None:
        if self.returncode is None and self._waitpid_lock.acquire(blocking=False):
            try:
                if self.returncode is None:
                    pid, status = self._try_wait(os.WNOHANG)
                    if pid:
                        self._handle_exitstatus(status)
            finally:
                self._waitpid_lock.release()
        return self.returncode


def run(arguments: Sequence[str | Path], *, timeout: float = 60, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run `python -m ARGUMENTS` to its end, within `timeout` wall seconds, and return what it printed as text."""
    streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with Forked(arguments, **streams | options) as process:
        try:
            out, err = process.communicate(timeout=timeout)
        except BaseException:
            process.kill()
            raise
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


@cache
def _parent() -> socket.socket:
    """Start the parent of all forked processes; it ends with this process. Return the socket of its requests."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        subprocess.Popen(
            [sys.executable, "-m", __name__, str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            cwd=ROOT,
            env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"},  # each child has its own
            pass_fds=[theirs.fileno()],
            start_new_session=True,
        )
    return ours


def serve(requests: socket.socket) -> list[str] | None:
    """Fork a process for each request until nobody is there to ask. Return None, or in each process its arguments."""
    told, ended = os.pipe()
    for end in (told, ended):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(ended, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    statuses: dict[int, int] = {}
    while True:
        ready, _, _ = select.select([requests, told], [], [])
        if told in ready:
            os.read(told, 4096)
            _tell_ends(statuses)
        if requests not in ready:
            continue
        text, files, _, _ = socket.recv_fds(requests, LARGEST, 4)
        if not text:
            return None
        request = json.loads(text)
        _prepare(*request["arguments"][:2])
        pid = os.fork()
        if pid == 0:
            requests.detach()
            return _begin(request, *files)
        statuses[pid] = files.pop()
        for file in files:
            os.close(file)


def _tell_ends(statuses: dict[int, int]) -> None:
    """Tell who asked for the processes that have ended how they did."""
    with suppress(ChildProcessError):
        while (found := os.waitpid(-1, os.WNOHANG))[0]:
            status = statuses.pop(found[0])
            with suppress(OSError):
                os.write(status, _NUMBER.pack(found[1]))
            os.close(status)


@cache
def _prepare(program: str, command: str = "") -> None:
    """Import what a command needs: its help needs most of it."""
    main = import_module(f"{program}.__main__").main
    with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere), suppress(SystemExit):
        main([command, "--help"])
    for module in _LATER:
        import_module(module)
    gc.collect()
    gc.freeze()


def _begin(request: Mapping[str, Any], *files: int) -> list[str]:
    """Make this process, which is forked, one of its own, and report its number when it can be killed as a group."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    end_with_parent(signal.SIGKILL)
    os.setsid()
    with suppress(OSError):
        os.write(files[3], _NUMBER.pack(os.getpid()))
    for number, file in enumerate(files[:3]):
        os.dup2(file, number)
    os.closerange(3, os.sysconf("SC_OPEN_MAX"))
    sys.stdin = open(0, closefd=False)  # noqa: SIM115 - for the rest of the process
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", buffering=1, errors="backslashreplace", closefd=False)  # noqa: SIM115
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    also = request["environment"].get("PYTHONPATH", "")
    sys.path[:1] = [request["folder"], *filter(None, also.split(os.pathsep))]
    return list(request["arguments"])


if __name__ == "__main__":
    arguments = serve(socket.socket(fileno=int(sys.argv[1])))
    if arguments is not None:
        sys.argv = arguments
        sys.modules.pop(f"{arguments[0]}.__main__", None)  # it runs as `__main__`
        runpy.run_module(arguments[0], run_name="__main__", alter_sys=True)
