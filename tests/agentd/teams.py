"""Teams in tests: agents from source text in one process, on virtual time, maybe in an environment."""

from typing import Any

from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_program
from agentd.standalone.standalone_team import Team, VirtualClock


class Stage:
    """A team and the lines that it printed."""

    def __init__(self, agents: dict[str, str], **arguments: Any) -> None:
        programs = [(name, compile_program(parse_program(text, f"{name}.asl"))) for name, text in agents.items()]
        self.lines: list[str] = []
        self.clock = arguments.pop("clock", None) or VirtualClock()
        self.team = Team(programs, out=self._write, clock=self.clock, **arguments)

    def _write(self, text: str) -> None:
        self.lines.append(text.rstrip("\n"))

    def run(self, timeout: float = 3600.0) -> int:
        """Run until nothing can happen any more, or the team stops."""
        return self.team.run(timeout, True)


def played(agents: dict[str, str], **arguments: Any) -> list[str]:
    """The lines that a team prints until nothing can happen any more, or it stops."""
    stage = Stage(agents, **arguments)
    stage.run()
    return stage.lines
