"""Which stretches of a mind's inputs are missing, whatever numbers an agent gives them."""

from argosy.recording.mind_inputs import MOST_MISSING, Minds, RecordedMind, Whose, range_text, stretches
from schemas.wire.mind_records import MindInputs

ABSURD = 10**30


def test_stretches_of_numbers_are_told_as_such() -> None:
    assert stretches([4, 1, 2, 7]) == [range(1, 3), range(4, 5), range(7, 8)]
    assert range_text(stretches([4, 1, 2, 7])) == "1-2, 4, 7"


def test_a_number_beyond_all_others_is_told_and_costs_nothing() -> None:
    mind = RecordedMind("test", "uav", "b1", [MindInputs(number=number) for number in (0, 1, ABSURD)])
    assert range_text(mind.missing) == f"2-{ABSURD - 1}"
    minds = Minds()
    whose = Whose("test", "uav", "b1")
    assert minds.heard(whose, 0)
    assert minds.heard(whose, ABSURD)
    assert f"batches {ABSURD - 1 - MOST_MISSING} more and " in str(minds.gaps()[0])
