"""What each daemon holds at rest, in times of a bare Python process with a Zenoh session that runs beside it.

The processes run a copy of the code that is compiled, so that a clone without byte code has the same figures.
"""

import sys

import pytest

from benchmarks import results
from benchmarks.measurements import footprint as footprints
from benchmarks.processes import lines, memory, started
from benchmarks.serving import NAMES, copied

BARE = 3.3
"""Times a Python that does nothing: what a session with a router takes."""


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> footprints.Figures:
    found, folder = footprints.Figures(), tmp_path_factory.mktemp("footprint")
    code = copied(folder / "code", compiled=True)
    for names in (footprints.TOGETHER, footprints.ALONE):
        footprints.look(found, names, folder / names[0], code, settled=1.0)
    return found


@pytest.mark.parametrize(("name", "bound"), footprints.BOUNDS.items())
def test_a_daemon_at_rest_is_no_larger_than_so_many_bare_processes(
    figures: footprints.Figures, name: str, bound: float
) -> None:
    held = figures.held[name].rss[0]
    bare = held / figures.ratio(name)
    assert figures.ratio(name) <= bound, f"{name} holds {held:.1f} MB, a bare process {bare:.1f} MB, bound {bound:g}"


def test_what_is_compared_with_has_a_session_and_little_else(figures: footprints.Figures) -> None:
    """A bare process that grew would let the daemons grow with it."""
    with started([sys.executable, "-P", "-c", "import time; print('there'); time.sleep(60)"]) as process:
        next(lines(process, 30))
        python = memory(process.pid, "VmRSS")
    bare = figures.held["bare"].rss[0]
    assert bare < BARE * python, f"a bare process holds {bare:.1f} MB, a Python that does nothing {python:.1f} MB"


def test_one_process_for_a_board_is_smaller_than_its_three(figures: footprints.Figures) -> None:
    three = sum(figures.held[name].rss[0] for name in ("commd", "bridged", "agentd"))
    assert figures.held["board"].rss[0] < 0.6 * three


def test_the_block_tells_each_kind_and_its_bound(figures: footprints.Figures) -> None:
    text = footprints.blocks(results.here("make bench", 0.0), figures)["footprint"]
    for name, bound in footprints.BOUNDS.items():
        (row,) = [line for line in text.splitlines() if line.startswith(f"| {NAMES[name]} |")]
        assert f"({figures.ratio(name):.2f})" in row
        assert row.endswith(f"| {bound:g} |")
