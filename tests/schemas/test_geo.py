"""Distances on the earth."""

import pytest

from schemas.geo import Position, distance, offset


@pytest.mark.parametrize(
    ("here", "there", "metres"),
    [
        ((0.0, 0.0), (0.0, 1.0), 111_319),
        ((0.0, 179.9995), (0.0, -179.9995), 111.3),
        ((60.0, 10.0), (60.0, 11.0), 55_659),
        ((90.0, 0.0), (90.0, 120.0), 0.0),
    ],
)
def test_distances_are_those_of_the_globe(here: Position, there: Position, metres: float) -> None:
    assert distance(here, there) == pytest.approx(metres, rel=1e-3, abs=0.01)
    assert distance(there, here) == distance(here, there)


def test_an_offset_counts_east_and_north_also_across_the_date_line() -> None:
    assert offset((60.0, 10.0), (60.001, 10.0)) == pytest.approx((0.0, 111.32), abs=0.01)
    assert offset((60.0, 179.9995), (60.0, -179.9995)) == pytest.approx((55.66, 0.0), abs=0.01)
