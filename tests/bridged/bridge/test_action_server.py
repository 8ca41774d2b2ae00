"""Every action has one final status that its asker can read, whatever the driver says or does."""

import logging
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bridged.bridge.running_action import MAX_FIGURES, MAX_ID, MAX_REASON
from bridged.drivers.api import Execution, Outcome
from schemas.wire.codec import codec
from schemas.wire.records import Action, ActionStatus
from tests.bridged.patient import Desk
from tests.bridged.sky import end_of


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path, 2)


def sent(status: ActionStatus) -> ActionStatus:
    """What an asker reads of a status."""
    return codec(ActionStatus).decode(codec(ActionStatus).encode(status))


def test_an_action_that_runs_wakes_the_bridge_whose_next_step_may_be_a_second_away(desk: Desk) -> None:
    assert desk.ask("a9")[-1].state == "refused"
    assert not desk.wake.is_set()
    desk.ask("a0")
    assert desk.wake.is_set()


def test_a_reason_that_is_no_unicode_is_told_all_the_same_and_holds_up_no_other_action(desk: Desk) -> None:
    first, second = desk.ask("a0", id="1"), desk.ask("a1", id="2")
    desk.robot.runs[0].end(Outcome("failed", "no file \udce9.csv"))
    desk.robot.runs[1].end(Outcome("succeeded"))
    assert end_of(sent(first[-1])) == ("failed", "no file ?.csv")
    assert end_of(sent(second[-1])) == ("succeeded", "")
    assert end_of(desk.ask("a0", id="1", attempt=2)[-1]) == ("failed", "no file ?.csv"), "and it is kept"


def test_a_cause_that_no_reader_would_know_is_that_of_the_driver(desk: Desk) -> None:
    asked = desk.ask("a0", id="1")
    jammed: Any = "gripper_jammed"
    desk.robot.runs[0].end(Outcome("failed", "it is stuck", jammed))
    assert sent(asked[-1]).cause == "driver"
    again = sent(desk.ask("a0", id="1", attempt=2)[-1])
    assert (again.cause, again.reason) == ("driver", "it is stuck"), "and it can be read from the action log"


def test_a_reason_without_an_end_is_cut(desk: Desk) -> None:
    asked = desk.ask("a0")
    desk.robot.runs[0].end(Outcome("failed", "x" * 100_000))
    assert len(asked[-1].reason) == MAX_REASON
    assert asked[-1].reason.endswith("x...")


def test_figures_that_are_no_numbers_are_left_out_and_do_not_turn_success_into_failure(desk: Desk) -> None:
    asked = desk.ask("a0", id="1")
    figures = desk.robot.runs[0].feedback
    figures.update({"ratio": math.nan, "speed": math.inf, "steps": 10**400, "to_go": 3, "word": "x"})  # type: ignore[dict-item]
    desk.step(2)
    assert sent(asked[-1]).feedback == {"to_go": 3.0}
    assert desk.feedback() == 1
    desk.robot.runs[0].end(Outcome("succeeded"))
    assert end_of(sent(asked[-1])) == ("succeeded", "")
    assert end_of(desk.ask("a0", id="1", attempt=2)[-1]) == ("succeeded", "")


def test_a_driver_that_sets_no_figures_does_not_keep_its_action_from_ending(desk: Desk) -> None:
    asked = desk.ask("a0")
    desk.robot.runs[0].feedback = None  # type: ignore[assignment]
    desk.robot.runs[0].end(Outcome("succeeded"))
    assert end_of(sent(asked[-1])) == ("succeeded", "")


def test_a_status_carries_no_more_figures_than_fit(desk: Desk) -> None:
    asked = desk.ask("a0")
    desk.robot.runs[0].feedback.update({f"figure{number}": number for number in range(1000)})
    desk.step(2)
    assert len(asked[-1].feedback) == MAX_FIGURES


def test_the_answer_to_one_action_is_not_given_to_another_of_the_same_id(desk: Desk) -> None:
    running = desk.ask("a0", id="x")
    assert end_of(desk.ask("a1", id="x")[-1]) == ("refused", "the id was used for a0 of uav")
    assert end_of(desk.ask("a0", "other", id="x")[-1]) == ("refused", "the id was used for a0 of uav")
    assert end_of(desk.action_server.cancel("other", "x")) == ("refused", "no action x of other"), "nor cancelled"
    desk.robot.runs[0].end(Outcome("succeeded"))
    assert running[-1].state == "succeeded"
    assert end_of(desk.ask("a1", id="x")[-1]) == ("refused", "the id was used for a0 of uav")
    assert end_of(desk.ask("a0", "other", id="x")[-1]) == ("refused", "the id was used for a0 of uav")
    assert end_of(desk.action_server.cancel("other", "x")) == ("refused", "no action x of other")
    assert desk.ask("a0", id="x")[-1].state == "succeeded", "its own answer is still known"
    assert desk.action_server.cancel("uav", "x").state == "succeeded"


def test_a_driver_that_fails_when_it_is_to_begin_has_failed_the_action_and_no_other(desk: Desk) -> None:
    desk.robot.defect = KeyError("gripper")
    asked = desk.ask("a0", id="x")
    state, reason = end_of(asked[-1])
    assert (state, reason.partition(" (")[0]) == ("failed", "driver `x`: perform raised KeyError: 'gripper'")
    assert end_of(desk.ask("a0", id="x", attempt=2)[-1]) == end_of(asked[-1])
    desk.robot.defect = None
    assert desk.ask("a0")[-1].state == "accepted"


def test_an_action_that_its_driver_cannot_end_is_over_all_the_same(desk: Desk) -> None:
    asked = desk.ask("a0", id="x")
    desk.robot.defect = KeyError("gripper")
    assert end_of(desk.action_server.cancel("uav", "x")) == ("cancelled", "cancelled by uav")
    assert asked[-1].state == "cancelled"
    assert desk.action_server.running == []


@pytest.mark.parametrize("deadline", [0.0, -5.0, math.nan])
def test_a_deadline_that_is_over_before_it_begins_is_refused(desk: Desk, deadline: float) -> None:
    refused = desk.ask("a0", deadline=deadline)[-1]
    assert end_of(refused) == ("refused", f"deadline: expected more than 0 s, got {deadline:g}")
    assert desk.robot.runs == []


def test_an_asker_may_want_it_sooner_than_the_manifest_and_not_later(desk: Desk) -> None:
    assert desk.ask("a0", deadline=2.5)[-1].deadline == 2.5
    longest = desk.ask("a1", deadline=1e300)[-1].deadline
    assert longest == float(desk.manifest.actions["a1"].deadline)


def test_an_id_of_any_length_is_not_kept(desk: Desk) -> None:
    refused = desk.ask("a0", id="x" * 1000)[-1]
    assert end_of(refused) == ("refused", f"an id has {MAX_ID} characters at most, got 1000")
    assert refused.id == "x" * MAX_ID
    assert desk.action_log.entries.get(refused.id) is None


def test_what_an_action_was_asked_for_with_is_not_kept_on_disk(desk: Desk) -> None:
    refused = desk.ask("a0", id="x", parameters=("y" * 100_000,))
    assert refused[-1].state == "refused"
    assert desk.action_log.path.stat().st_size < 1000
    kept = desk.action_log.entries.get("x")
    assert (kept.agent, kept.name, kept.reason) == ("uav", "a0", refused[-1].reason)


def test_an_action_stands_in_the_log_before_a_driver_that_may_never_return_is_called(
    desk: Desk, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    before: list[list[str]] = []
    perform = desk.robot.perform

    def called(*arguments: Any) -> Execution:
        before.append(list(caplog.messages))
        return perform(*arguments)

    monkeypatch.setattr(desk.robot, "perform", called)
    with caplog.at_level(logging.INFO, "actions"):
        desk.ask("a0", id="1")
    assert before == [["robot=r action 1 a0[]"]]
    assert caplog.messages == before[0], "and once only"


def test_the_agent_has_the_end_of_its_action_before_observers_hear_of_it(desk: Desk) -> None:
    heard: list[ActionStatus | None] = []
    when_told: list[int] = []
    desk.told = Told(lambda: when_told.append(len(heard)))
    desk.robot.defect = KeyError("gripper")  # so that the action ends while it is begun
    desk.action_server.ask("uav", "a0", Action(id="1"), heard.append)
    assert [one.state for one in heard if one is not None] == ["failed"]
    assert [one.state for one in desk.told] == ["accepted", "failed"], "observers hear of its beginning too"
    assert when_told == [1, 1]


class Told(list[ActionStatus]):
    """The statuses for observers; each one is noted when it is put."""

    def __init__(self, note: Callable[[], None]) -> None:
        super().__init__()
        self._note = note

    def append(self, status: ActionStatus) -> None:
        self._note()
        super().append(status)
