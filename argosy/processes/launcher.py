"""Starts one process of a mission so that it cannot outlive `argosy run`, even when that is killed with -9.

Run as a script by `argosy.processes.supervisor`: it asks the kernel to send a signal when the parent dies
(`prctl(PR_SET_PDEATHSIG)`, kept across exec) and then becomes the process. It imports as little as it can.
"""

import ctypes
import os
import sys

PR_SET_PDEATHSIG = 1


def end_with_parent(signal: int) -> None:
    """Let the kernel send a signal to this process when its parent dies. Raises OSError."""
    if ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal, 0, 0, 0) != 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))


def main() -> None:
    """Become the command of `launch.py SIGNAL PARENT_PID COMMAND...`, which gets SIGNAL when PARENT_PID dies."""
    signal, parent, command = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]
    try:
        end_with_parent(signal)
    except OSError as error:
        sys.exit(f"error: prctl: {error.strerror}")
    if os.getppid() != parent:  # it died before the kernel knew: there is nobody left to run for
        sys.exit(1)
    try:
        os.execvp(command[0], command)  # noqa: S606  the list is ours, and no shell reads it
    except OSError as error:
        sys.exit(f"error: {command[0]}: {error.strerror}")


if __name__ == "__main__":
    main()
