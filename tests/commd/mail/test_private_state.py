"""What daemons keep is for their user alone, whatever the umask is."""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from agentd.extensions.file_access import AgentFiles
from agentd.persistence.checkpoint import Checkpoint
from argosy.recording.writer import _opened
from bridged.bridge.action_log import ActionLog
from commd.mail.store import alone
from commd.process.restart_counter import note_start
from commd.process.sqlite_file import SqliteFile


@pytest.fixture
def open_umask() -> Iterator[None]:
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.mark.usefixtures("open_umask")
def test_state_is_for_its_user_alone_whatever_the_umask(tmp_path: Path) -> None:
    state = tmp_path / "state"
    old = state / "fleet" / "old"
    with alone(state / "fleet" / "mail.sqlite"):
        old.write_bytes(b"")  # as an earlier version made it
        database = SqliteFile(state / "fleet" / "mail.sqlite", (), "full").open()
        database.execute("CREATE TABLE t (a)")
        SqliteFile(old, (), "full").open().close()
        checkpoint = Checkpoint.open(state / "fleet" / "bob.minds")
        AgentFiles([], state / "fleet" / "bob").save("saved/new.asl", "a.")
        action_log = ActionLog(state / "fleet" / "uav1.actions")
        note_start(state / "fleet", "agentd", "bob")
        _opened(state / "fleet" / "rec.mcap", overwrite=False).close()
        modes = {path: stat.S_IMODE(path.stat().st_mode) for path in [state, *state.rglob("*")]}
        wrong = {str(path): oct(mode) for path, mode in modes.items() if mode != (0o700 if path.is_dir() else 0o600)}
        assert wrong == {}
        assert {"mail.sqlite-wal", "mail.sqlite-shm", "bob.minds-wal"} <= {path.name for path in modes}
        database.close()
        checkpoint.close()
        action_log.close()


def test_a_folder_that_was_there_keeps_the_mode_that_its_maker_gave_it(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    with alone(tmp_path / "mail.sqlite"):
        pass
    assert stat.S_IMODE(tmp_path.stat().st_mode) == 0o755
    with pytest.raises(FileNotFoundError):
        SqliteFile(tmp_path / "none" / "mail.sqlite", (), "full").open()
