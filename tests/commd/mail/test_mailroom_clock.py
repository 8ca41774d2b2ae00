"""The age of mail does not depend on what the wall clock shows, and goes on over boots of the computer."""

from __future__ import annotations

import sqlite3

from commd.mail.age_clock import MailClock
from commd.mail.schema import migrate
from tests.commd.offices import Time


def test_time_goes_on_for_a_daemon_that_starts_again_and_counts_the_time_between() -> None:
    db, now = sqlite3.connect(":memory:", isolation_level=None), Time()
    migrate(db)
    first = MailClock(now, "boot 1")
    now.seconds += 50
    first.save(db)
    now.seconds += 25
    second = MailClock(now, "boot 1")
    assert second.now() == 0
    second.load(db)
    assert second.now() == first.now() == 75


def test_after_a_boot_time_goes_on_from_what_was_written_down_with_the_seconds_since_the_boot() -> None:
    db, now = sqlite3.connect(":memory:", isolation_level=None), Time()
    migrate(db)
    first = MailClock(now, "boot 1")
    now.seconds += 50
    first.save(db)
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
    db, now = sqlite3.connect(":memory:", isolation_level=None), Time()
    migrate(db)
    first = MailClock(now, "")
    now.seconds += 50
    first.save(db)
    second = MailClock(now, "")
    second.load(db)
    assert second.now() == 200, "never less than what was written down"


def test_a_file_that_says_nothing_begins_at_zero() -> None:
    db = sqlite3.connect(":memory:", isolation_level=None)
    migrate(db)
    clock = MailClock()
    clock.load(db)
    assert 0 <= clock.now() < 60
