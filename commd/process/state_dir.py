"""Folders and files of a daemon's state."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path


def state_directory(given: Path | None) -> Path:
    """Return the given folder, systemd's state directory, or the user's; fleets have folders below it."""
    if given is not None:
        return given
    if systemd := os.environ.get("STATE_DIRECTORY"):
        return Path(systemd.partition(":")[0])
    base = os.environ.get("XDG_STATE_HOME") or (Path.home() / ".local" / "state" if "HOME" in os.environ else ".")
    return Path(base) / "argosy"


def make_private_folder(path: Path) -> None:
    """Make a folder and its missing parents for this user alone (0700), whatever the umask.

    An existing folder keeps its mode. Raises OSError.
    """
    missing = [path, *path.parents]
    for folder in reversed([one for one in missing if not one.exists()]):
        folder.mkdir(mode=0o700, exist_ok=True)
    if not path.is_dir():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))


def replace_file(path: Path, content: bytes, *, private: bool = True, synced: bool = True) -> None:
    """Write a file as a whole or not at all; `private`: for this user alone, `synced`: forced to the disk.

    Without `synced` a power failure may leave it empty. Raises OSError, which names the file.
    """
    new = path.with_name(f".{path.name}.new")
    try:
        if private:
            make_private_file(new)
        with new.open("wb") as file:
            file.write(content)
            file.flush()
            if synced:
                os.fsync(file.fileno())
        os.replace(new, path)
    except OSError as error:
        with suppress(OSError):
            new.unlink(missing_ok=True)
        error.filename = str(path)
        raise


def write_output(path: Path, content: bytes) -> None:
    """Write a file that a user has named, as a whole or not at all; into a link, pipe or device as it is.

    Raises OSError, which names the file.
    """
    if path.is_symlink() or (path.exists() and not path.is_file()):
        path.write_bytes(content)  # to replace /dev/stdout would be no help
    else:
        replace_file(path, content, private=False)


def probe(folder: Path, size: int) -> None:
    """Write a file of `size` bytes and remove it. Raises OSError."""
    make_private_folder(folder)
    path = folder / f".probe.{os.getpid()}"
    try:
        replace_file(path, bytes(size), synced=False)
    finally:
        path.unlink(missing_ok=True)


def make_private_file(path: Path) -> None:
    """Make a file readable for this user alone (0600), before anything is written; create it empty if it is missing.

    SQLite gives the files beside a database, `-wal` and `-shm`, the database's mode. Raises OSError.
    """
    try:
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
    except FileExistsError:
        for one in (path, Path(f"{path}-wal"), Path(f"{path}-shm")):
            with suppress(FileNotFoundError, PermissionError):  # another user's file keeps its mode
                if one.stat().st_mode & 0o077:
                    one.chmod(0o600)
