"""What the processes of a run write: where it is shown, and what is known of the robots by it."""

from types import SimpleNamespace
from typing import Any

import pytest

from argosy.cli.journal import Level
from argosy.processes.process_table import KINDS, Process
from argosy.run.mission_runner import ProcessOutput
from schemas.wire import log_lines
from schemas.wire.log_lines import LeftAs, LogLine, OrderEnded, RobotLeft, RobotReleased
from tests.argosy.recorded import Recording


class Heard:
    """A run, and the lines of its processes."""

    def __init__(self) -> None:
        self.recording = Recording()
        self.output = ProcessOutput(self.recording.status)

    def line(self, kind: str, subject: str, line: LogLine) -> tuple[str, str, Level] | None:
        """Take a line; return what the journal shows of it."""
        entries = self.recording.status.journal.entries
        before = len(entries)
        process = Process(next(one for one in KINDS if one.name == kind), subject, (), label=subject)
        child: Any = SimpleNamespace(process=process, name=process.name)
        self.output.wrote(child, line)
        return (entries[-1].who, entries[-1].text, entries[-1].level) if len(entries) > before else None

    def event(self, event: log_lines.AnyEvent) -> tuple[str, str, Level] | None:
        """Take an event of the bridge of uav1."""
        return self.line("bridged", "uav1", LogLine(text="for people", level="info", event=event))


@pytest.mark.parametrize(
    ("level", "shown"), [("error", "error"), ("warning", "warning"), ("notice", "output"), ("info", None)]
)
def test_a_line_is_shown_by_its_level(level: log_lines.Level, shown: Level | None) -> None:
    found = Heard().line("bridged", "uav1", LogLine(text="serving uav1", level=level))
    assert found == (None if shown is None else ("bridged uav1", "serving uav1", shown))


def test_at_the_end_of_a_run_all_lines_are_shown() -> None:
    heard = Heard()
    heard.output.ending = True
    assert heard.line("bridged", "uav1", LogLine(text="leaves", level="info")) == ("bridged uav1", "leaves", "output")


def test_what_a_program_prints_is_its_agents() -> None:
    heard = Heard()
    assert heard.line("agentd", "uav", LogLine(text="hello", agent="uav")) == ("uav", "hello", "print")
    assert list(heard.recording.model.agents["uav"].prints) == ["hello"]


def test_nobody_prints_for_an_agent_of_another_process() -> None:
    heard = Heard()
    heard.line("agentd", "uav2", LogLine(text="hello", agent="uav"))
    heard.line("bridged", "uav1", LogLine(text="hello", agent="uav"))
    assert not heard.recording.model.agents["uav"].prints


def test_what_an_agent_prints_that_was_created_at_run_time_is_shown_with_its_name() -> None:
    found = Heard().line("agentd", "uav", LogLine(text="hello", agent="helper"))
    assert found == ("agentd uav", "[helper] hello", "output")


@pytest.mark.parametrize(
    ("state", "level"), [("ordered", "good"), ("disarmed", "info"), ("piloted", "warning"), ("unconfirmed", "error")]
)
def test_how_a_bridge_left_its_robot_is_kept(state: LeftAs, level: Level) -> None:
    heard = Heard()
    left = RobotLeft(robot="uav1", state=state, text="so")
    assert heard.event(left) == ("uav1", "its bridge left it: so", level)
    assert heard.recording.status.left == {"uav1": left}


def test_the_outcome_of_an_operators_order_is_shown_although_no_action_ran() -> None:
    heard = Heard()
    confirmed = OrderEnded(robot="uav1", order="land", confirmed=True)
    assert heard.event(confirmed) == ("uav1", "land confirmed: the vehicle does it", "good")
    assert heard.recording.model.robots["uav1"].seen.operator == "land"
    failed = OrderEnded(robot="uav1", order="rtl", confirmed=False, reason="no answer")
    assert heard.event(failed) == ("uav1", "rtl NOT confirmed: no answer", "error")
    heard.event(RobotReleased(robot="uav1"))
    assert heard.recording.model.robots["uav1"].seen.operator == ""


def test_no_other_process_reports_on_a_robot() -> None:
    heard, left = Heard(), RobotLeft(robot="uav1", state="disarmed")
    heard.line("agentd", "uav1", LogLine(text="a program wrote it", event=left))
    heard.line("bridged", "uav2", LogLine(text="of another robot", event=left))
    assert heard.recording.status.left == {}
