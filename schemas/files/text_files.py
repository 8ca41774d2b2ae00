"""Read files that users name: regular files of bounded size, text in UTF-8."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO, Final

from schemas.files.findings import Finding, Findings, near_miss

DISK_FAILS: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS})
"""Errors of a disk that is full or broken: what may be done without it goes on."""
MAY_PASS: Final = DISK_FAILS | {errno.EMFILE, errno.ENFILE, errno.ENOMEM}
"""These, and errors of a machine without a free file or memory: no input is bad, and a later start may succeed."""
MAX_FILE = 150_000
"""Bytes; a mission or manifest is a few thousand."""
MAX_LINE = 10_000
"""Characters of a line: some readers need the square of its length."""
MAX_PROGRAM = 16 * 2**20
"""Bytes of a program, the saved ones of agents included."""
_PROGRAMS, _MISSIONS = "programs are for `agentd run` and `agentd check`", "missions are for `argosy run`"
_USES = {
    ".asl": _PROGRAMS,
    ".mas2j": _PROGRAMS,
    ".yaml": _MISSIONS,
    ".yml": _MISSIONS,
    ".toml": "manifests are for `argosy manifest`",
    ".mcap": "recordings are for `argosy replay`",
}
"""Files that have commands of their own, by suffix."""


def near_file(path: str | Path) -> str:
    """Return the hint of `near_miss` if a file of nearly this name and the same suffix is in its folder."""
    path = Path(path)
    try:
        there = [one.stem for one in path.parent.iterdir() if one.suffix == path.suffix and one.is_file()]
    except (OSError, ValueError):
        return ""
    return near_miss(path.stem, there, suffix=path.suffix)


def other_kind(path: str | Path, own: str) -> str:
    """Return what a file is for by its suffix; empty for an unknown suffix and for those of the kind of `own`."""
    use = _USES.get(Path(path).suffix, "")
    return "" if use == _USES[own] else use


def open_regular(path: str | Path) -> BinaryIO:
    """Open a file to read; a fifo or device is refused before anything waits for it. Raises OSError."""
    number = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY)
    try:
        mode = os.fstat(number).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, "no regular file (a pipe, socket or device): name a file", str(path))
        return os.fdopen(number, "rb")
    except BaseException:
        os.close(number)
        raise


def read_bounded(path: str | Path, most: int = MAX_PROGRAM) -> bytes:
    """Return what is in a regular file. Raises OSError, also for one of more than `most` bytes."""
    with open_regular(path) as file:
        try:
            content = file.read(most + 1)
        except OSError as error:
            error.filename = str(path)
            raise
    if len(content) > most:
        raise OSError(errno.EFBIG, f"larger than {most} bytes: not a file of this kind", str(path))
    return content


def read_text(path: Path) -> str:
    """Return the text of a file.

    Raises Findings if it cannot be read, is too large, or is no text, OSError of `MAY_PASS`.
    """
    try:
        content = read_bounded(path, MAX_FILE)
    except OSError as error:
        if error.errno in MAY_PASS:
            raise
        what = f"{error.strerror}" if error.errno == errno.EFBIG else f"cannot be read: {error.strerror}"
        what += near_file(path) if error.errno == errno.ENOENT else ""
        raise Findings.about(path, what) from None
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise Findings([Finding(str(path), line, 0, "expected UTF-8 text")]) from None
    for number, one in enumerate(text.splitlines(), start=1):
        if len(one) > MAX_LINE:
            problem = f"a line of {len(one)} characters, expected at most {MAX_LINE}"
            raise Findings([Finding(str(path), number, 0, problem)])
    return text
