"""Where daemons keep what must outlive them."""

import errno
import os
from pathlib import Path

import pytest

from agentd.extensions import file_access
from bridged import daemon as bridge
from commd import daemon as comm
from commd.process.state_dir import state_directory, write_output


def test_the_state_directory_is_given_or_systemds_or_the_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/argosy:/var/lib/other")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert state_directory(tmp_path) == tmp_path
    assert state_directory(None) == Path("/var/lib/argosy")
    monkeypatch.delenv("STATE_DIRECTORY")
    assert state_directory(None) == tmp_path / "state" / "argosy"
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert state_directory(None) == tmp_path / ".local" / "state" / "argosy"
    monkeypatch.delenv("HOME")
    assert state_directory(None) == Path("argosy")


def test_all_daemons_keep_their_state_in_the_same_place() -> None:
    assert {vars(module)["state_directory"] for module in (bridge, comm, file_access)} == {state_directory}


def test_a_file_that_a_user_named_is_written_whole_or_not_at_all_and_a_link_or_device_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, link = tmp_path / "a.xml", tmp_path / "link.xml"
    link.symlink_to(file)
    write_output(link, b"one")
    assert (link.is_symlink(), file.read_bytes()) == (True, b"one")
    write_output(Path("/dev/null"), b"two")
    assert Path("/dev/null").is_char_device()

    def full(number: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"a[.]xml"):
        write_output(file, b"three")
    assert (file.read_bytes(), sorted(tmp_path.iterdir())) == (b"one", [file, link])
