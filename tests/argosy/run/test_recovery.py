"""What a run does with vehicles in the air before it ends, in virtual time."""

import asyncio
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from argosy.processes.process_table import plan
from argosy.processes.supervisor import Child, Restarts, Supervisor
from argosy.run import recovery as module
from argosy.run.end_conditions import EndConditions, Ending
from argosy.run.recovery import Recovery, Watchdog
from schemas.wire.log_lines import RobotLeft
from schemas.wire.terms import Atom
from tests.argosy.recorded import Recording
from tests.argosy.run.test_screen import in_flight

FAILED = Ending(1, 'failed: uav believes mission_failed("wind")', graced=True)


def outcome(
    recording: Recording, monkeypatch: pytest.MonkeyPatch, at: dict[int, Callable[[], None]], bridge_dies: int = 1_000
) -> tuple[Ending | None, float]:
    """Return what the grace ends with and after how long; `at` says what happens after that many wall seconds."""
    wall, status = [0.0], recording.status
    supervisor = Supervisor(lambda child, line: None, lambda child: None)
    process = next(one for one in plan(status.setup) if one.kind.name == "bridged")
    bridge = Child(process, SimpleNamespace(pid=1, returncode=None))  # type: ignore[arg-type]
    supervisor.children.append(bridge)
    end_conditions, watchdog = EndConditions(status, supervisor), Watchdog(status)
    restarts = Restarts(supervisor, status.journal, status.restarts, on=False)

    async def sleep(seconds: float) -> None:
        wall[0] += seconds
        if wall[0] >= bridge_dies:
            bridge.asked_to_leave, bridge.died = True, wall[0]
        if event := at.pop(int(wall[0]), None):
            event()

    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: wall[0]))
    monkeypatch.setattr(module, "asyncio", SimpleNamespace(sleep=sleep, Event=asyncio.Event))
    recovery = Recovery(status, supervisor, end_conditions, watchdog, restarts)
    ending = end_conditions.look()
    assert ending == FAILED
    return asyncio.run(recovery.outlasts_grace(ending, lambda: "ctrl-C" if wall[0] > 500 else "")), wall[0]


def failing() -> Recording:
    """Return a recording whose agent gives up in flight."""
    recording = in_flight()
    recording.fail('mission_failed("wind")[source(self)]')
    return recording


def test_a_failure_ends_a_run_in_flight_after_the_grace(monkeypatch: pytest.MonkeyPatch) -> None:
    assert outcome(failing(), monkeypatch, {}) == (FAILED, 10.0)


def test_the_grace_does_not_run_while_an_operator_has_paused_a_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = failing()
    at = {4: lambda: recording.percept("paused", Atom("operator")), 104: lambda: recording.percept_gone("paused")}
    ending, wall = outcome(recording, monkeypatch, at)
    assert (ending, wall) == (FAILED, 110.0)


def test_a_paused_run_ends_by_ctrl_c_and_when_nobody_can_let_its_robot_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = failing()
    recording.percept("paused", Atom("operator"))
    assert outcome(recording, monkeypatch, {})[1] == 500.25
    assert recording.lines[-1].endswith("before the mission ends, counted from `argosy stop continue` on")
    assert outcome(recording, monkeypatch, {}, bridge_dies=100)[1] == 110.0


def test_a_mission_that_is_done_during_the_grace_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = failing()
    assert outcome(recording, monkeypatch, {3: lambda: recording.mind(done=True)}) == (Ending(0, "done"), 3.0)


def test_a_mission_that_is_done_while_its_vehicle_is_paused_in_the_air_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = failing()

    def done() -> None:
        recording.percept("paused", Atom("operator"))
        recording.mind(done=True)

    assert outcome(recording, monkeypatch, {3: done}) == (None, 3.0)
    recording.percept_gone("paused")
    supervisor = Supervisor(lambda child, line: None, lambda child: None)
    assert EndConditions(recording.status, supervisor).look() == Ending(0, "done")


def test_a_vehicle_that_its_bridge_has_left_disarmed_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = failing()
    left = RobotLeft(robot="uav1", state="disarmed", text="not armed")
    assert outcome(recording, monkeypatch, {3: lambda: recording.status.left.update(uav1=left)}) == (FAILED, 3.0)
