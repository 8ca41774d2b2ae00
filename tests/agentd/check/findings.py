"""The findings of `agentd check` about one program."""

from collections.abc import Iterable

from agentd.check.command import Robot, findings_of
from agentd.check.external_knowledge import Arities, Elsewhere
from agentd.check.programs import read_survey
from agentd.language.parse import parse_program
from agentd.language.syntax_tree.nodes import Program
from agentd.runtime.program_paths import SourcePaths
from schemas.files.findings import Finding


def findings_about(
    program: Program | str,
    actions: Arities | None = None,
    percepts: Arities | None = None,
    beliefs: Iterable[tuple[str, int]] = (),
) -> list[Finding]:
    """The findings about a program or its text; ``beliefs`` are those that other agents may send."""
    if isinstance(program, str):
        program = parse_program(program, "a.asl")
    surveyed = read_survey(program, SourcePaths())
    return findings_of(surveyed, Robot(actions, percepts), Elsewhere(beliefs=frozenset(beliefs)))
