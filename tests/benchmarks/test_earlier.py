"""An earlier revision beside this one: its product under today's benchmarks, or a word that it is not there."""

from __future__ import annotations

import pytest

from benchmarks.earlier.part import PAIRS, REVISION
from benchmarks.earlier.probes import PROBES
from benchmarks.earlier.trees import tree
from benchmarks.processes import BenchmarkFailed
from benchmarks.results import ROOT


def test_a_revision_that_the_clone_does_not_have_is_told() -> None:
    with pytest.raises(BenchmarkFailed, match="revision 0000000 is not in this clone"), tree("0000000"):
        pass


def test_a_tree_has_the_product_of_then_and_the_benchmarks_of_now() -> None:
    try:
        with tree(REVISION) as made:
            assert (made / "commd/bus.py").read_text() != (ROOT / "commd/bus/bus.py").read_text()
            assert not (made / "commd/known_keys.py").exists()
            probes = "benchmarks/earlier/probes.py"
            assert (made / probes).read_text() == (ROOT / probes).read_text()
        assert not made.exists()
    except BenchmarkFailed as error:
        pytest.skip(str(error))


def test_every_probe_is_run() -> None:
    assert PAIRS.keys() == PROBES.keys()
