"""What the processes of a run write, as the journal and the picture take it."""

from __future__ import annotations

import re

from argosy.cli.journal import Level
from argosy.processes.supervisor import Child
from argosy.run.output_lines import Left, Ordered, Released, of_a_bridge, read_line
from argosy.run.run_status import Status

_PRINTED = re.compile(r"\[([^\]\s]+)\] (.*)")
"""How agentd writes what a program prints."""


class Hearing:
    """Takes each line of each process."""

    def __init__(self, status: Status) -> None:
        self.ending = False
        """Whether the run is over: then what daemons only inform about is shown too."""
        self._picture, self._journal, self._left = status.picture, status.journal, status.left

    def wrote(self, child: Child, line: str) -> None:
        """Take a line that a process has written."""
        printed = _PRINTED.fullmatch(line)
        if printed and printed[1] in child.process.subject.split() and child.process.kind.name == "agentd":
            self._picture.printed(printed[1], printed[2])
            return
        said = read_line(line)
        told = of_a_bridge(said) if child.process.kind.name == "bridged" else None
        if told is not None:
            self._bridge_told(told)
        elif said.level == "detail" and self.ending:
            self._journal.add(child.name, said.text, "output")
        else:
            self._journal.add(child.name, said.text, said.level)

    def _bridge_told(self, told: Left | Ordered | Released) -> None:
        """Pass on what a bridge did with a vehicle above the agents: nothing else tells when no action ran."""
        if told.robot not in self._picture.robots:
            return
        match told:
            case Left(robot, how):
                self._left[robot] = told
                level: Level = "good" if told.confirmed else "info" if how == "not armed" else "error"
                level = "warning" if told.to_pilot else level
                self._journal.add(robot, f"its bridge left it: {how}", level)
            case Ordered(robot, order, True, reason):
                self._picture.ordered(robot, order)
                self._journal.add(robot, f"{order} confirmed: {reason or 'the vehicle does it'}", "good")
            case Ordered(robot, order, _, reason):
                self._picture.ordered(robot, order)
                self._journal.add(robot, f"{order} NOT confirmed: {reason}", "error")
            case Released(robot):
                self._picture.released(robot)
