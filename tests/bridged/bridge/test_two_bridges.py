"""Which of two bridges of a robot gives way to the other."""

from itertools import product

from bridged.bridge.two_bridges import NEAR, UNDECIDED, gives_way
from schemas.wire.records import Header, Health


def other(boot: str, uptime: float) -> Health:
    return Health(header=Header(boot=boot), uptime=round(uptime, 1))


def test_the_younger_gives_way_and_of_two_of_an_age_the_one_with_the_higher_boot_id() -> None:
    assert gives_way("a", 3.0, other("b", 60.0))
    assert not gives_way("b", 60.0, other("a", 3.0))
    assert gives_way("b", 60.0, other("a", 60.5))
    assert not gives_way("a", 60.5, other("b", 60.0))


def test_two_bridges_never_give_way_to_each_other_however_late_their_records_are() -> None:
    for apart, late, later in product([n / 20 for n in range(-int(40 * NEAR), int(40 * NEAR))], (0.0, 0.3), (0.0, 2.0)):
        older, younger = 100.0 + apart, 100.0
        first = gives_way("a", older, other("b", younger - late))
        assert not (first and gives_way("b", younger, other("a", older - later))), apart


def test_one_of_two_bridges_gives_way_in_the_end_whatever_is_between_their_starts() -> None:
    for apart, late in product([n / 20 for n in range(-int(60 * NEAR), int(60 * NEAR))], (0.0, 0.3)):
        older, younger = 100.0 + apart, 100.0
        assert any(
            gives_way("a", older, other("b", younger - late), heard)
            or gives_way("b", younger, other("a", older - late), heard)
            for heard in (1, UNDECIDED)
        ), apart
