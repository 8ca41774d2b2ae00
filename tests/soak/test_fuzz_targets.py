"""Whatever strangers send is read or refused, in time and in bounds; `python -m tests.soak.fuzz` goes on further."""

import random

import pytest

from tests.soak.fuzz_targets import BOMBS, GROWTH, TARGETS, Target, fuzz, read_one
from tests.support.amount import some_of

SEED = 0
INPUTS = some_of(2000, 2)
_BY_NAME = {target.name: target for target in TARGETS}


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_any_input_is_read_or_refused_in_time_and_nothing_grows(target: Target) -> None:
    found = fuzz(target, SEED, INPUTS)
    assert not found.failures, [f"--only {target.name!r} {number}: {what}" for number, what in found.failures[:5]]
    assert found.growth < GROWTH
    assert found.outcomes["read"] > INPUTS / 20, "some inputs are good enough to get far"


@pytest.mark.parametrize(
    ("name", "text"),
    [(name, text) for name, texts in BOMBS.items() for text in texts],
    ids=lambda part: part[:20].strip(),
)
def test_what_is_made_to_be_slow_is_read_or_refused_within_a_second(name: str, text: str) -> None:
    read_one(_BY_NAME[name], text.encode(), random.Random(SEED))
