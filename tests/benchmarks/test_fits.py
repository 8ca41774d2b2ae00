"""Fits find again what points were made of, also through noise."""

from __future__ import annotations

import math
import random

import pytest

from benchmarks import spread as fits


def test_lines_and_powers_are_found_again() -> None:
    line = fits.line([(size, 3.0 + 0.5 * size) for size in (1, 10, 50, 100)])
    assert line.base == pytest.approx(3.0)
    assert line.each == pytest.approx(0.5)
    assert line.reaches(53.0) == pytest.approx(100.0)
    assert fits.line([(1, 4.0), (10, 4.0)]).reaches(5.0) == math.inf
    steep = fits.power([(size, 3.0 + size**1.5) for size in (1, 10, 50, 100)])
    assert (steep.power, str(steep)) == (1.5, "size ^ 1.50")
    assert steep.off == pytest.approx(0.0, abs=1e-6)
    assert steep.reaches(1003.0) == pytest.approx(100.0)
    with pytest.raises(ValueError, match="two sizes"):
        fits.line([(5, 1.0), (5, 2.0)])
    with pytest.raises(ValueError, match="4 sizes"):
        fits.power([(1, 1.0), (5, 2.0), (10, 3.0)])


def test_noise_does_not_make_a_power_of_a_line() -> None:
    assert fits.power([(1, 1.0), (10, 0.9), (100, 1.5), (300, 3.0), (1000, 9.0)]).power < 1.2
    noise = random.Random(1)
    for power in (1.0, 2.0):
        for _ in range(20):
            points = [(size, (1 + 0.01 * size**power) * noise.uniform(0.9, 1.1)) for size in (1, 10, 100, 300, 1000)]
            assert fits.power(points).power == pytest.approx(power, abs=0.25)


def test_what_hardly_changes_does_not_grow() -> None:
    flat = fits.power([(1, 1.0), (10, 0.9), (100, 1.1), (1000, 1.0)])
    assert (flat.power, str(flat)) == (0.0, "does not grow")
    assert flat.reaches(2.0) == math.inf
    nothing = fits.power([(size, 0.0) for size in (1, 10, 100, 1000)])
    assert (nothing.power, nothing.off) == (0.0, 0.0)
