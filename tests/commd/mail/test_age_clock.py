"""The age of mail does not depend on what the wall clock shows, and goes on over boots of the computer."""

import sqlite3
from contextlib import closing

import pytest

from commd.mail.age_clock import WENT_BACK, MailClock, RollbackWitness
from commd.mail.queries import MIGRATIONS
from commd.process.sqlite_file import migrate
from schemas.wire.records import BoardServices, Header, MailSeen
from tests.commd.offices import Time


def saved_after_50(boot: str) -> tuple[sqlite3.Connection, Time, MailClock]:
    """A file that a clock was saved in after 50 seconds, and both clocks."""
    db, now = sqlite3.connect(":memory:", isolation_level=None), Time()
    migrate(db, MIGRATIONS)
    clock = MailClock(now, boot)
    now.seconds += 50
    clock.save(db)
    return db, now, clock


def test_time_goes_on_for_a_daemon_that_starts_again_and_counts_the_time_between() -> None:
    db, now, first = saved_after_50("boot 1")
    now.seconds += 25
    second = MailClock(now, "boot 1")
    assert second.now() == 0
    second.load(db)
    assert second.now() == first.now() == 75


def test_after_a_boot_time_goes_on_from_what_was_written_down_with_the_seconds_since_the_boot() -> None:
    db, now, _ = saved_after_50("boot 1")
    now.seconds = 8.0
    second = MailClock(now, "boot 2")
    second.load(db)
    assert second.now() == 58
    second.save(db)
    now.seconds += 2
    third = MailClock(now, "boot 2")
    third.load(db)
    assert third.now() == 60


def test_where_the_kernel_does_not_tell_its_boots_each_start_counts_as_one() -> None:
    db, now, _ = saved_after_50("")
    second = MailClock(now, "")
    second.load(db)
    assert second.now() == 200, "never less than what was written down"


def test_a_file_that_says_nothing_begins_at_zero() -> None:
    db = sqlite3.connect(":memory:", isolation_level=None)
    migrate(db, MIGRATIONS)
    clock = MailClock()
    clock.load(db)
    assert 0 <= clock.now() < 60


def _clock(found: float | None) -> MailClock:
    clock = MailClock()
    clock.found = found
    return clock


def _says(board: str, boot: str, mail_time: float, **seen: MailSeen) -> BoardServices:
    return BoardServices(header=Header(boot=boot), board=board, mail_time=mail_time, mail_seen=seen)


def _seen_of_two_lives(first: float, second: float | None) -> MailSeen:
    """What pi2 has seen of pi1, whose file had come to `first` in life `one`, and says `second` in life `two`."""
    witness = RollbackWitness("pi2", "x", _clock(0.0))
    for boot, mail_time in (("one", first - 5), ("one", first), ("two", second)):
        if mail_time is not None and (seen := witness.news(_says("pi1", boot, mail_time))) is not None:
            witness.seen = {"pi1": seen}
    return witness.seen["pi1"]


@pytest.mark.parametrize("second", [None, 40.0, 500.0], ids=["before it heard", "after it", "after it, clock gone on"])
def test_a_restored_file_is_told_once(second: float | None) -> None:
    witness = RollbackWitness("pi1", "two", _clock(40.0))
    witness.judge(_says("pi2", "x", 7.0, pi1=_seen_of_two_lives(100.0, second)))
    assert (witness.note.code, witness.note.value) == (WENT_BACK, 60.0)
    assert all(part in witness.note.text for part in ("board pi1", "60 s", "board pi2"))
    told = witness.note
    witness.judge(_says("pi3", "y", 7.0, pi1=MailSeen(boot="one", time=900.0)))
    assert witness.note is told


@pytest.mark.parametrize("found", [100.0, 103.0, None], ids=["in order", "after kill -9", "not open yet"])
def test_a_file_that_went_on_is_not(found: float | None) -> None:
    witness = RollbackWitness("pi1", "two", _clock(found))
    for seen in (_seen_of_two_lives(100.0, None), _seen_of_two_lives(100.0, 120.0), MailSeen()):
        witness.judge(_says("pi2", "x", 7.0, pi1=seen))
    witness.judge(_says("pi2", "x", 7.0))
    assert witness.note is None


def test_what_was_seen_is_on_disk() -> None:
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as db:
        migrate(db, MIGRATIONS)
        RollbackWitness("pi2", "x", _clock(0.0)).keep(db, "pi1", MailSeen(boot="one", time=9.0, former=3.0))
        db.execute("INSERT INTO facts VALUES('mail_seen', 'pi3', x'00')")
        again = RollbackWitness("pi2", "y", _clock(0.0))
        again.load(db)
        assert again.seen == {"pi1": MailSeen(boot="one", time=9.0, former=3.0)}
        assert again.news(_says("pi1", "one", 9.0)) is None
        assert again.news(_says("pi1", "two", 0.0)) is None  # an older commd says nothing of its file
