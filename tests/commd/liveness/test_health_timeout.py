"""Which daemons hang although their tokens are there: virtual time, no bus."""

from __future__ import annotations

import pytest

from commd.liveness.presence import CATCH_UP, Silence
from schemas.liveness import FIRST_HEALTH, SILENT_AFTER


def looked_at(silence: Silence, begin: float, end: float) -> list[tuple[float, str]]:
    """Look twice a second; return when somebody was found silent first."""
    found: dict[str, float] = {}
    wall = begin
    while wall <= end:
        for name in silence.silent(wall):
            found.setdefault(name, wall)
        wall += 0.5
    return [(at, name) for name, at in found.items()]


@pytest.fixture
def silence() -> Silence:
    """An agent that has spoken at 10.0."""
    silence = Silence()
    silence.token("uav", "b1", True, 9.0)
    silence.word("uav", "b1", 10.0)
    return silence


def test_who_speaks_once_a_second_is_not_silent(silence: Silence) -> None:
    for second in range(11, 60):
        assert not looked_at(silence, second - 1, second - 0.5)
        silence.word("uav", "b1", second)


def test_who_says_nothing_any_more_is_silent_after_the_patience(silence: Silence) -> None:
    assert looked_at(silence, 10, 30) == [(10 + SILENT_AFTER, "uav")]


def test_who_speaks_again_is_not_silent_any_more(silence: Silence) -> None:
    looked_at(silence, 10, 20)
    silence.word("uav", "b1", 20.2)
    assert not silence.silent(20.5)


def test_the_first_word_may_take_longer() -> None:
    silence = Silence()
    silence.token("uav", "b1", True, 0.0)
    assert looked_at(silence, 0, 60) == [(FIRST_HEALTH, "uav")]


def test_a_patience_that_is_longer_than_the_first_word_may_take_counts_for_it_too() -> None:
    silence = Silence(FIRST_HEALTH + 10)
    silence.token("uav", "b1", True, 0.0)
    assert looked_at(silence, 0, 60) == [(FIRST_HEALTH + 10, "uav")]


def test_who_has_no_token_is_not_judged(silence: Silence) -> None:
    silence.token("uav", "b1", False, 11.0)
    silence.word("uav", "b1", 12.0)
    assert not looked_at(silence, 10, 60)


def test_a_new_life_speaks_for_the_old_one_whose_token_is_still_there(silence: Silence) -> None:
    silence.token("uav", "b2", True, 14.0)
    assert looked_at(silence, 14, 60) == [(14 + FIRST_HEALTH, "uav")]
    silence.word("uav", "b2", 60.0)
    assert not silence.silent(60.5)


def test_after_a_pause_of_our_own_others_have_time_to_be_heard(silence: Silence) -> None:
    assert not looked_at(silence, 10, 12)
    assert looked_at(silence, 40, 60) == [(40 + CATCH_UP, "uav")]


def test_a_pause_of_our_own_excuses_nobody_for_longer_than_that(silence: Silence) -> None:
    assert not looked_at(silence, 10, 11)
    assert looked_at(silence, 13, 60) == [(10 + SILENT_AFTER, "uav")]


def test_after_the_router_was_away_words_have_time_to_come(silence: Silence) -> None:
    silence.excuse(14.0, SILENT_AFTER)
    assert looked_at(silence, 14, 60) == [(14 + SILENT_AFTER, "uav")]


def test_who_hangs_and_then_dies_was_not_back_between(silence: Silence) -> None:
    looked_at(silence, 10, 20)
    silence.token("uav", "b1", False, 20.0)
    assert silence.silent(20.5) == ["uav"]
    silence.token("uav", "b2", True, 22.0)
    assert not silence.silent(22.5), "another life of it is there"


def test_who_hangs_hangs_on_when_its_token_is_told_again(silence: Silence) -> None:
    looked_at(silence, 10, 20)
    silence.excuse(20.0, SILENT_AFTER)
    silence.token("uav", "b1", True, 20.0)
    assert silence.silent(20.5) == ["uav"]
    silence.word("uav", "b1", 21.0)
    assert not silence.silent(21.5)


def test_who_has_spoken_has_no_first_word_to_say_when_its_token_comes_again(silence: Silence) -> None:
    silence.token("uav", "b1", False, 11.0)
    silence.token("uav", "b1", True, 12.0)
    assert looked_at(silence, 12, 60) == [(12 + SILENT_AFTER, "uav")]
