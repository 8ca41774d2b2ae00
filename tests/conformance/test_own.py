"""Our own cases: what the specification of the dialect says that a program prints, on virtual time in one process."""

from pathlib import Path

import pytest

from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_file
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.mind import Mind
from agentd.mind.data.effects import Print, StopTeam
from tests.agentd.minds import World

HERE = Path(__file__).parent / "own"
LONG_ENOUGH = 100.0
"""No case waits longer than so many seconds."""


def _output(path: Path) -> str:
    world = World(Mind("bob", compile_program(parse_file(path), parse_file), actions=())).at(LONG_ENOUGH)
    printed = []
    for effect in world.effects:
        if isinstance(effect, StopTeam):
            break
        if isinstance(effect, Print):
            printed.append(f"[bob] {effect.text}\n")
    return "".join(printed)


@pytest.mark.parametrize("case", sorted(p.stem for p in HERE.glob("*.out")))
def test_a_program_prints_what_the_specification_says(case: str) -> None:
    assert _output(HERE / f"{case}.asl") == (HERE / f"{case}.out").read_text()


@pytest.mark.parametrize("case", sorted(p.stem for p in HERE.glob("*.err")))
def test_a_wrong_program_is_refused_at_its_place(case: str) -> None:
    place = (HERE / f"{case}.err").read_text().splitlines()[0]
    with pytest.raises(SyntaxErrors) as refused:
        compile_program(parse_file(HERE / f"{case}.asl"), parse_file)
    assert f"{case}.asl:{place}" in str(refused.value)
