"""How the sizes of programs are counted."""

import shutil
import subprocess
from pathlib import Path

import pytest

from benchmarks import results
from benchmarks.measurements.sizes import (
    AGENTSPEAK,
    MISSIONS,
    PYTHON,
    Figures,
    Source,
    bare_agentspeak,
    bare_python,
    count,
    goals,
    measure,
)
from benchmarks.peers import Size
from benchmarks.results import ROOT
from schemas.mission.model import load_mission


def test_a_program_is_counted_as_gzip_and_wc_count_it() -> None:
    file = ROOT / "missions/single_uav/uav.asl"
    found = count(file.read_text())
    counted = subprocess.run(["wc", "-lw", file], capture_output=True, text=True, check=True).stdout.split()
    assert (found.lines, found.words) == (int(counted[0]), int(counted[1]))
    if (gzip := shutil.which("gzip")) is not None:
        packed = subprocess.run([gzip, "-nc", file], capture_output=True, check=True).stdout
        assert abs(found.bytes - len(packed)) <= 0.01 * len(packed)  # there is more than one deflate


def test_of_agentspeak_comments_and_blank_lines_go_and_strings_stay() -> None:
    text = '/* a\n   b */\n\n+!go : x   // why\n  <- .print("no // comment, /* nor */ \\" this").\n'
    assert bare_agentspeak(text) == '+!go : x\n  <- .print("no // comment, /* nor */ \\" this").\n'


def test_of_python_comments_docstrings_and_blank_lines_go_and_strings_stay() -> None:
    text = '"""Doc."""\n\nclass A(Exception):\n    """Of a class."""\n\n\n'
    text += 'def f():  # why\n    """Two\n    lines."""\n    return "# no"\n'
    assert bare_python(text) == 'class A(Exception):\n    ...\ndef f():\n    return "# no"\n'


@pytest.mark.parametrize("mission", MISSIONS)
def test_the_programs_that_are_counted_are_all_that_the_agents_run(mission: str) -> None:
    agents = load_mission(ROOT / "missions" / f"{mission}.yaml").agents
    counted = MISSIONS[mission].agents
    assert counted[AGENTSPEAK].keys() == counted[PYTHON].keys() == agents.keys()
    for name, agent in agents.items():
        program = f"missions/{agent.program}"
        first, *included = counted[AGENTSPEAK][name]
        assert first == program
        text = (ROOT / program).read_text()
        assert [f"missions/search_and_rescue/{one}" for one in _included(text)] == included
        module, *imported = counted[PYTHON][name]
        text = (ROOT / module).read_text()
        assert {Path(one).stem for one in imported} == _imported(text)


def _included(text: str) -> list[str]:
    return [line.split('"')[1] for line in text.splitlines() if line.startswith("{ include(")]


def _imported(text: str) -> set[str]:
    begin = "from benchmarks.imperative."
    return {line.removeprefix(begin).split()[0] for line in text.splitlines() if line.startswith(begin)}


def test_a_goal_is_missed_by_one_measure() -> None:
    small, equal = Source("a", Size(1, 1, 1), Size(1, 1, 1)), Source("b", Size(2, 1, 2), Size(2, 2, 2))
    figures = Figures({name: {AGENTSPEAK: [small], PYTHON: [equal]} for name in MISSIONS})
    whole, bare, *_ = goals(figures)
    assert not whole.met
    assert whole.why.startswith("lines are not: ")
    assert bare.met


def test_the_results_are_the_sizes_of_the_programs_as_they_are_now() -> None:
    _, figures = results.load("sizes", Figures)
    assert figures == measure(True), "the programs have changed since: make bench ARGS=sizes"
