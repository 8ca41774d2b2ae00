"""The files of a mission that a board needs: the mission file, its agents' programs, the manifests that are paths.

They keep their places relative to the mission file. What ships with Argosy is there already; secrets are not copied.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from agentd.language.compiler.compile import DirectiveError, compile_program
from agentd.language.parse import parse_file
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import Program
from agentd.runtime.program_loader import compose
from argosy.deploy.device_access import agents_of
from schemas.files.findings import Finding, Findings
from schemas.files.yaml_positions import Steps
from schemas.mission.model import Mission


def files_of(mission: Mission, board: str) -> dict[str, Path]:
    """Return the files that a board needs by their path relative to the mission file.

    Raises Findings for what cannot be read, or does not stand below the mission file's folder.
    """
    folder = mission.path.resolve().parent
    found = {mission.path.name: mission.path.resolve()}
    if elsewhere := outside(mission, board):
        raise Findings(elsewhere)
    for _, path in _named(mission, board):
        found[str(path.resolve().relative_to(folder))] = path.resolve()
    return dict(sorted(found.items()))


def outside(mission: Mission, board: str) -> list[Finding]:
    """Return a finding for each place that names a file which is not below the mission file.

    Raises Findings for what cannot be read.
    """
    folder = mission.path.resolve().parent
    found: dict[Steps, Finding] = {}
    for where, path in _named(mission, board):
        path = path.resolve()
        if where not in found and not path.is_relative_to(folder):
            text = f"{path} is not below the mission file, whose folder is what a board gets: put it there"
            found[where] = mission.positions.finding(where, text)
    return list(found.values())


def secrets_of(mission: Mission, board: str) -> list[str]:
    """Return the files with passphrases that the robots of a board need, as the mission names them."""
    robots = (robot for robot in mission.robots.values() if robot.board == board)
    return [robot.signing.passphrase_file for robot in robots if robot.signing is not None]


def _named(mission: Mission, board: str) -> Iterator[tuple[Steps, Path]]:
    for agent in agents_of(mission, board):
        where = ("agents", agent, "program")
        for source in _sources(mission, agent):
            yield where, source
            for beside in sorted(source.parent.glob("*.asl")):  # a program may include them at run time
                if not beside.name.endswith("_test.asl"):
                    yield where, beside
    for name, robot in mission.robots.items():  # of all: agents and access rules need to know others' actions
        for one in (robot.manifest,) if isinstance(robot.manifest, str) else robot.manifest:
            if (path := mission.relative(one)).is_file():  # else it is the name of one that ships
                yield ("robots", name, "manifest"), path


def _sources(mission: Mission, agent: str) -> list[Path]:
    """Return the files that the program of an agent is made of."""
    found = [mission.relative(mission.agents[agent].program)]

    def load(path: str) -> Program:
        found.append(Path(path))
        return parse_file(path)

    try:
        compile_program(compose(mission, agent), load)
    except SyntaxErrors as errors:
        raise Findings(errors.findings) from None
    except DirectiveError as error:
        where = error.position
        raise Findings([Finding(where.file, where.line, where.column, error.message)]) from None
    return found
