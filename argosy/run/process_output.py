"""Takes the lines of a run's processes into its journal, and what they report into its picture."""

from __future__ import annotations

from collections.abc import Mapping

from argosy.cli.journal import Level
from argosy.processes.supervisor import Child
from argosy.run.run_status import Status
from schemas.wire import log_lines
from schemas.wire.log_lines import AnyEvent, LogLine, OrderEnded, RobotLeft, RobotReleased

_LEVELS: Mapping[log_lines.Level, Level] = {
    "error": "error",
    "warning": "warning",
    "notice": "output",
    "info": "detail",
}


class ProcessOutput:
    """Takes each line of each process."""

    def __init__(self, status: Status) -> None:
        self.ending = False
        """Whether the run is over: then what daemons only inform about is shown too."""
        self._picture, self._journal, self._left = status.picture, status.journal, status.left

    def wrote(self, child: Child, line: LogLine) -> None:
        """Take a line that a process has written."""
        kind, subjects = child.process.kind.name, child.process.subject.split()
        if kind == "agentd" and line.agent in subjects:
            self._picture.printed(line.agent, line.text)
        elif kind == "agentd" and line.agent:  # an agent that was created at run time
            self._journal.add(child.name, f"[{line.agent}] {line.text}", "output")
        elif kind == "bridged" and getattr(line.event, "robot", None) in subjects:
            self._reported(line.event)
        else:
            level = _LEVELS[line.level]
            self._journal.add(child.name, line.text, "output" if level == "detail" and self.ending else level)

    def _reported(self, event: AnyEvent | None) -> None:
        """Take what a bridge did with a robot above its agents: nothing else reports it when no action ran."""
        match event:
            case RobotLeft(robot=robot, state=state, text=text):
                self._left[robot] = event
                levels: dict[str, Level] = {"ordered": "good", "disarmed": "info", "piloted": "warning"}
                self._journal.add(robot, f"its bridge left it: {text}", levels.get(state, "error"))
            case OrderEnded(robot=robot, order=order, confirmed=True, reason=reason):
                self._picture.ordered(robot, order)
                self._journal.add(robot, f"{order} confirmed: {reason or 'the vehicle does it'}", "good")
            case OrderEnded(robot=robot, order=order, reason=reason):
                self._picture.ordered(robot, order)
                self._journal.add(robot, f"{order} NOT confirmed: {reason}", "error")
            case RobotReleased(robot=robot):
                self._picture.released(robot)
