"""Whatever the text, the parser reads it or says what is wrong with it, in time; what it reads can be run."""

import random
from collections import Counter
from functools import lru_cache
from pathlib import Path

import pytest

from agentd.language.parse import parse_file
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import Program
from tests.agentd import mutants
from tests.agentd.mutants import mutant
from tests.agentd.trials import Pace, try_to_read, try_to_run
from tests.support.amount import some_of

SEED = 0
"""Of the series of inputs; `make soak` takes another and goes on to a million."""

INPUTS = some_of(2000)
RUNS = some_of(300)


@lru_cache(maxsize=1)
def read() -> dict[int, Program | None]:
    """What came of each input."""
    found: dict[int, Program | None] = {}
    pace = Pace()
    for number in range(INPUTS):
        text = mutant(SEED, number)
        try:
            found[number] = try_to_read(text)
            slow = pace.too_slow(text)
        except BaseException as error:
            error.add_note(f"input {number}: python -m tests.soak.parser --seed {SEED} --only {number}")
            raise
        assert not slow, f"input {number} {slow}"
    return found


def test_any_text_is_a_program_or_is_refused_in_words_and_in_time() -> None:
    found = read()
    assert len(found) == INPUTS
    programs = sum(program is not None for program in found.values())
    assert INPUTS / 10 < programs < INPUTS / 2, "the inputs are good enough to get far, and bad enough to be refused"


def test_what_is_read_runs_without_a_world_and_nothing_escapes_from_the_mind() -> None:
    programs = [(number, program) for number, program in read().items() if program is not None][:RUNS]
    assert len(programs) == RUNS
    ended: Counter[str] = Counter()
    for number, program in programs:
        try:
            ended[try_to_run(program)] += 1
        except BaseException as error:
            error.add_note(f"input {number}: python -m tests.soak.parser --seed {SEED} --only {number}")
            raise
    assert ended["idle"] > RUNS / 2


def test_a_file_of_any_bytes_is_read_or_refused(tmp_path: Path) -> None:
    rng = random.Random(SEED)
    path = tmp_path / "any.asl"
    for _ in range(200):
        path.write_bytes(rng.randbytes(rng.randint(0, 100)))
        try:
            parse_file(path)
        except SyntaxErrors as errors:
            assert errors.findings


@pytest.mark.parametrize("make", mutants.KINDS, ids=lambda make: make.__name__)
def test_an_input_is_made_again_from_its_seed(make: mutants.Make) -> None:
    assert make(random.Random("1/2")) == make(random.Random("1/2"))
