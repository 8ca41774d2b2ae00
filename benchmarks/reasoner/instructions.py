"""Count the interpreter's instructions per cycle of the mind, by function.

    python -m benchmarks.reasoner.instructions f

Counts do not depend on the load of the machine, so that two versions can be compared by them. Work in C (dicts, deques,
calls of built-ins) is not counted.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter as Counts
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, Final

import msgspec

from agentd.environment import Environment
from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_file
from agentd.process import allow_deep_calls
from agentd.standalone import standalone_team
from benchmarks.processes import BenchmarkFailed, lines, started
from benchmarks.reasoner.counter import Counter
from benchmarks.reasoner.rows import ROWS, Row

WARM_TURNS: Final = 200
"""Turns of the team before counting begins: plans and rules are compiled, objects that are kept are there."""
COUNTED_TURNS: Final = 100
CYCLES_A_TURN: Final = 40
GENERATED: Final = "the programs' generated code"
SHOWN: Final = 25
"""So many functions are shown, the dearest first."""


class _Enough(Exception):
    pass


class CountedTeam(standalone_team.Team):
    """A team that counts what is executed in `COUNTED_TURNS` of its turns, then ends."""

    counts: Counts[CodeType]
    cycles: int
    _turn = 0

    def turns(self) -> bool:
        self._turn += 1
        if self._turn == WARM_TURNS:
            self.counts, self.cycles = Counts(), -self._cycles_run()
            sys.settrace(self._enter)
        elif self._turn == WARM_TURNS + COUNTED_TURNS:
            sys.settrace(None)
            self.cycles += self._cycles_run()
            raise _Enough
        return super().turns()

    def _cycles_run(self) -> int:
        return sum(mind.cycle for mind in self.minds.values())

    def _enter(self, frame: FrameType, event: str, argument: Any) -> Any:
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        return self._each

    def _each(self, frame: FrameType, event: str, argument: Any) -> Any:
        if event == "opcode":
            self.counts[frame.f_code] += 1
        return self._each


def count(row: Row) -> CountedTeam:
    """Run a row's programs until enough has been counted."""
    environment: Environment | None = Counter() if row.environment else None
    arguments: Sequence[str] = ("10", "1000000") if row.environment else ()
    programs = [(name, compile_program(parse_file(path), parse_file)) for name, path in row.paths()]
    if len(programs) == 1:
        standalone_team.CYCLES_A_TURN = CYCLES_A_TURN  # an agent alone gives way only then
    team = CountedTeam(programs, out=lambda text: None, environment=environment, environment_arguments=arguments)
    try:
        team.run(None, True)
    except _Enough:
        return team
    raise SystemExit(f"{row.key} ended before its {WARM_TURNS + COUNTED_TURNS} turns were over")


@dataclass(frozen=True)
class Counted:
    """What a row's cycle takes."""

    whole: float
    """Instructions of the interpreter per cycle of a mind."""
    modules: dict[str, float]
    """The same by module; those of the programs' own generated code are together."""


def by_module(team: CountedTeam) -> Counted:
    """Return what was counted by module, the dearest first."""
    found: Counts[str] = Counts()
    for code, count in team.counts.items():
        name = Path(code.co_filename).name
        found[name if name.endswith(".py") else GENERATED] += count
    whole = sum(found.values()) / team.cycles
    return Counted(whole, {name: count / team.cycles for name, count in found.most_common()})


def count_apart(row: Row) -> Counted:
    """Count a row in a process of its own. Raises BenchmarkFailed."""
    command = [sys.executable, "-m", "benchmarks.reasoner.instructions", row.key, "--json"]
    with started(command) as process:
        printed = list(lines(process))
    try:
        return msgspec.json.decode(printed[-1], type=Counted)
    except (IndexError, msgspec.DecodeError):
        raise BenchmarkFailed(f"{' '.join(command)}: {printed[-1:]}") from None


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reasoner.instructions")
    parser.add_argument("row", choices=[row.key for row in ROWS])
    parser.add_argument("--json", action="store_true", help="by module, for programs")
    args = parser.parse_args()
    allow_deep_calls()
    team = count(next(row for row in ROWS if row.key == args.row))
    if args.json:
        print(msgspec.json.encode(by_module(team)).decode())
        return
    total = sum(team.counts.values())
    print(f"{total / team.cycles:.0f} instructions per cycle")
    for code, found in team.counts.most_common(SHOWN):
        print(f"{found / team.cycles:8.1f} {found / total:6.1%}  {code.co_qualname} ({Path(code.co_filename).name})")


if __name__ == "__main__":
    main()
