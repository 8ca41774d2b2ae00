"""Drivers that cannot open their links, or fail: what becomes of the robot, and of those served beside it."""

import asyncio
import errno
import os
import pty
import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from bridged.bridge import composite_driver
from bridged.bridge.composite_driver import DriverSupervisor, may_come
from bridged.daemon import leave, serve
from bridged.drivers.api import Execution, Outcome
from bridged.drivers.mavlink.transport import endpoint as endpoints
from bridged.drivers.mavlink.transport.framing import Encoder
from bridged.drivers.mavlink.transport.link import LinkAddress, LinkError, open_link
from bridged.drivers.registry import DriverError, check_manifest, check_robot
from commd.process.systemd import Loop, Unit
from schemas.files.findings import Findings
from schemas.manifest.loader import find_manifest
from schemas.mission.model import Mission, Robot, read_mission
from schemas.wire import keys
from schemas.wire.percept_set import PerceptSet
from schemas.wire.records import Health, Note, Perception
from schemas.wire.terms import Atom
from tests.bridged.airfield import command_line, until
from tests.bridged.airfield import serving as serving_the_airfield
from tests.bridged.plugins import install
from tests.bridged.radio import BEAT, Speaker
from tests.bridged.sky import MISSION, end_of
from tests.bridged.workshop import MISSION as workshop_mission
from tests.bridged.workshop import Workshop, checked, in_the_workshop
from tests.support.buses import Connect, on_a_bus, virtual_test
from tests.support.notes import identities
from tests.support.notify_socket import NotifySocket
from tests.support.ports import free_port

SONAR = """
import asyncio
from bridged.drivers.simple import SimpleDriver
from bridged.drivers.api import Execution

echo, trouble, runs = asyncio.Event(), [], []

def check_manifest(manifest): return ()
def check_robot(robot): return ()

class Sonar(SimpleDriver):
    def perform(self, name, entry, arguments):
        return Execution(name)

    async def run(self):
        runs.append(1)
        self.report("range", {"metres": 2.5})
        await echo.wait()
        echo.clear()
        if trouble:
            raise trouble.pop()

def make_driver(setup): return Sonar(setup)
"""
PERCEPT = """
[percepts.range]
driver = "sonar"
source = "range"
args = ["metres"]
[actions.ping]
driver = "sonar"
call = "ping"
motion = false
"""
BENCH = f"""
[robot]
driver = "python"
[percepts.tick]
source = "bench.tick"
args = ["data"]
rate = 100
{PERCEPT}
"""


@pytest.fixture
def sonar(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The module of a driver that fails when it is told to."""
    counting = 'from itertools import count\n__all__ = ["tick"]\ncounter = count()\ndef tick(): return next(counter)\n'
    points = {"argosy.drivers": {"sonar": "my_sonar"}, "argosy.python.simulated": {"bench": "my_bench"}}
    points["argosy.python"] = points["argosy.python.simulated"]
    install(monkeypatch, tmp_path, {"my_sonar": SONAR, "my_bench": counting}, points)
    monkeypatch.setattr(composite_driver, "PAUSES", (0.1, 0.1))
    monkeypatch.setattr(composite_driver, "LASTS", 0.2)
    from bridged.drivers.registry import find_driver

    find_driver.cache_clear()
    find_driver("sonar")
    yield sys.modules["my_sonar"]
    find_driver.cache_clear()


async def failing(workshop: Workshop, sonar: Any, error: Exception) -> None:
    """The driver of the sonar fails while it carries out an action; the robot's own goes on."""
    await workshop.perceives("range", 2.5)
    heard = workshop.begin("ping")
    await until(lambda: bool(heard), "accepted")
    sonar.trouble.append(error)
    sonar.echo.set()
    await until(lambda: heard[-1].final, "the action ends")
    assert heard[-1].state == "failed"
    raised = "" if isinstance(error, OSError) else f"run raised {type(error).__name__}: "
    assert f"driver `sonar` does not run: {raised}{error}" in heard[-1].reason
    before = workshop.present("tick")
    await until(lambda: workshop.present("tick") != before, "the robot's own driver goes on")


async def test_an_auxiliary_driver_without_link_is_run_again_and_the_own_goes_on(sonar: Any, tmp_path: Path) -> None:
    async with in_the_workshop(Workshop(tmp_path, checked(BENCH))) as workshop:
        await failing(workshop, sonar, OSError("unplugged"))
        await workshop.perceives("range", 2.5)
        await until(lambda: not workshop.bridge.health().notes, "all is well again")
        assert len(sonar.runs) == 2


ALONE = """
[robot]
driver = "sonar"
[percepts.range]
source = "range"
args = ["metres"]
ttl = "0.3s"
[actions.ping]
call = "ping"
motion = false
deadline = "0.3s"
"""


@pytest.mark.parametrize("defect", [False, True], ids=["", "a defect at the first look"])
@virtual_test
async def test_percepts_age_and_deadlines_are_kept_whatever_the_driver_does(
    sonar: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, defect: bool
) -> None:
    async with in_the_workshop(Workshop(tmp_path, checked(ALONE))) as workshop:
        reported: list[str] = []
        asyncio.get_running_loop().set_exception_handler(lambda _, context: reported.append(context["message"]))
        if defect:
            step = workshop.bridge.percepts.tick
            failures = [KeyError("depth")]

            def fails_once() -> float:
                if failures:
                    raise failures.pop()
                return step()

            monkeypatch.setattr(workshop.bridge.percepts, "tick", fails_once)
        await workshop.perceives("range", 2.5)
        status = await workshop.do("ping")
        assert (status.state, status.cause) == ("timed_out", "deadline")
        await workshop.perceives("range")
        assert reported == (["looking at bench"] if defect else [])
        assert len(sonar.runs) == 1


async def test_an_auxiliary_driver_with_a_defect_is_given_up_its_entries_refused(sonar: Any, tmp_path: Path) -> None:
    async with in_the_workshop(Workshop(tmp_path, checked(BENCH))) as workshop:
        await failing(workshop, sonar, KeyError("depth"))
        place = f"{sonar.__file__}:21, in run"
        why = f"run raised KeyError: 'depth' ({place}); it is not run again before the bridge is restarted"
        said = f"driver `sonar` does not run: {why}"
        assert workshop.bridge.health().notes == (Note("driver_down", said, "sonar"),)
        assert workshop.present("range") == [], "what it told holds no longer"
        assert end_of(await workshop.do("ping")) == ("refused", said)
        assert len(sonar.runs) == 1


async def test_a_copter_in_flight_keeps_its_link_and_its_way_home_when_another_driver_of_it_fails(
    endpoint: str, sonar: Any, tmp_path: Path
) -> None:
    copter = find_manifest("copter")
    rigged = tmp_path / "rigged.toml"
    rigged.write_text(copter.read_text() + PERCEPT)
    mission = MISSION.replace("copter", str(rigged))
    async with serving_the_airfield(endpoint, tmp_path, mission=mission) as (field, agent):
        notes: list[tuple[str, str]] = []
        agent.subscribe(
            keys.health("test", "uav1", "bridged"), Health, lambda _, health: notes.extend(identities(health.notes))
        )
        await field.take_off(agent)
        sonar.trouble.append(RuntimeError("a defect"))
        sonar.echo.set()
        await until(lambda: ("driver_down", "sonar") in notes, "it is told")
        assert not field.daemon.done()
        assert (await field.do(agent, "takeoff", 10)).state in ("succeeded", "refused", "failed")
        await field.leave()
        assert field.vehicle.autopilot.mode.name == "RTL"


WATCHFUL = """
[robot]
driver = "mavlink"
vehicle = "copter"
link_loss = "1s"
[percepts.link]
source = "LINK"
args = ["state"]
"""


def two_robots(folder: Path, first: str, second: str) -> Mission:
    """A mission of two robots, each with an agent and a link."""
    (folder / "watchful.toml").write_text(WATCHFUL)
    text = f"""
mission: two
fleet: test
agents:
  a1: {{program: a.asl, robot: r1}}
  a2: {{program: a.asl, robot: r2}}
robots:
  r1: {{manifest: watchful.toml, link: '{first}', sysid: 1}}
  r2: {{manifest: watchful.toml, link: '{second}', sysid: 2}}
"""
    return read_mission(text, folder / "two.yaml")


def serving(mission: Mission, endpoint: str, state: Path, *robots: str) -> tuple[asyncio.Task[int], asyncio.Event]:
    """The bridge daemon of some robots, and what stops it."""
    stop = asyncio.Event()
    said = command_line(endpoint, state, *robots)
    return asyncio.create_task(serve(mission, said, stop)), stop


def test_a_link_that_cannot_be_opened_at_the_start_takes_no_other_robot_down_and_is_opened_when_it_can_be(
    endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(composite_driver, "PAUSES", (0.1, 0.5))
    port, device = free_port(), tmp_path / "telemetry"

    async def body(connect: Connect) -> None:
        bus = await connect()
        seen, health = {name: PerceptSet() for name in ("a1", "a2")}, Health()

        def hear(_: str, one: Health) -> None:
            nonlocal health
            health = one

        for name, copy in seen.items():
            bus.subscribe(keys.percept("test", name, "*"), Perception, lambda _, one, copy=copy: copy.apply(one))  # type: ignore[misc]
        bus.subscribe(keys.health("test", "r2", "bridged"), Health, hear)

        def link(agent: str) -> list[object]:
            return [one.parameters[0] for one in seen[agent].present() if one.name == "link"]

        mission = two_robots(tmp_path, f"udpin:127.0.0.1:{port}", f"serial:{device}:57600")
        daemon, stop = serving(mission, endpoint, tmp_path, "r1", "r2")
        vehicle = Speaker(port)

        def first_is_heard() -> bool:
            vehicle.say(BEAT)
            return link("a1") == [Atom("up")]

        try:
            await until(lambda: link("a2") == [Atom("down")], "the missing device is told to its agent")
            await until(lambda: ("driver_down", "mavlink") in identities(health.notes), "and to people")
            await until(first_is_heard, "the other robot is served")
            far, near = pty.openpty()
            device.symlink_to(os.ttyname(near))
            encoder = Encoder(2, 1)

            def second_is_heard() -> bool:
                os.write(far, encoder.pack(BEAT))
                return link("a2") == [Atom("up")]

            await until(second_is_heard, "the device is plugged in")
            await until(lambda: ("driver_down", "mavlink") not in identities(health.notes), "the note is taken back")
        finally:
            stop.set()
            vehicle.close()
            assert await daemon == 0

    on_a_bus(endpoint, body)


async def test_a_robot_alone_waits_for_its_device_and_a_port_that_is_taken_ends_its_bridge(
    connect: Connect, endpoint: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    await connect()
    taken = Speaker()
    mission = two_robots(tmp_path, f"udpin:127.0.0.1:{taken.port}", f"serial:{tmp_path}/nothing:57600")
    ends, _ = serving(mission, endpoint, tmp_path, "r1")
    assert await ends == 1
    assert f"link udpin:127.0.0.1:{taken.port} cannot be opened: address already in use" in caplog.text
    waits, stop = serving(mission, endpoint, tmp_path, "r2")
    await until(lambda: "nothing:57600 cannot be opened: no such file or directory; it is tried" in caplog.text, "")
    assert not waits.done()
    stop.set()
    assert await waits == 0
    taken.close()


async def test_a_driver_that_cannot_be_made_and_a_state_folder_that_cannot_be_used_are_told_with_the_robot(
    connect: Connect, endpoint: str, tmp_path: Path, sonar: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(setup: object) -> None:
        raise KeyError("pin")

    await connect()
    mission = two_robots(tmp_path, f"udpin:127.0.0.1:{free_port()}", "udpin:127.0.0.1:0")
    (tmp_path / "file").write_text("")
    daemon, _ = serving(mission, endpoint, tmp_path / "file", "r1")
    with pytest.raises(Findings, match=r"two.yaml:8:.* robot r1 cannot be served: .*file.*: Not a directory"):
        await daemon
    (tmp_path / "watchful.toml").write_text(WATCHFUL + PERCEPT)
    monkeypatch.setattr(sonar, "make_driver", broken)
    daemon, _ = serving(mission, endpoint, tmp_path, "r1")
    with pytest.raises(Findings, match="robot r1 cannot be served: driver `sonar`: make_driver raised KeyError: 'pin'"):
        await daemon
    monkeypatch.setattr(sonar, "make_driver", Mock(side_effect=OSError(errno.EMFILE, "Too many open files")))
    daemon, _ = serving(mission, endpoint, tmp_path, "r1")
    with pytest.raises(OSError, match="Too many open files"):  # a later start may succeed
        await daemon


async def test_a_driver_that_ends_by_itself_is_a_failure_in_words(sonar: Any, tmp_path: Path) -> None:
    async with in_the_workshop(Workshop(tmp_path, checked(BENCH))) as workshop:
        await workshop.perceives("range", 2.5)
        sonar.echo.set()
        await until(lambda: identities(workshop.bridge.health().notes) == [("driver_down", "sonar")], "it is told")


def test_a_robot_that_cannot_be_left_for_a_defect_does_not_keep_others_from_being_left(
    sonar: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def defect(order: str) -> str:
        raise KeyError(order)

    workshop = Workshop(tmp_path, checked(BENCH))
    workshop.bridge.orders.shut_down = defect  # type: ignore[method-assign]
    mission = read_mission(workshop_mission, tmp_path / "workshop.yaml")
    caplog.set_level("INFO")
    asyncio.run(leave(workshop.bridge, mission, 0.0, asyncio.Event()))
    assert "leaving bench: unknown because of a defect" in caplog.text


def test_a_driver_that_looks_at_its_robot_and_opens_its_link_slowly_is_not_missed(tmp_path: Path) -> None:
    class Slow:
        """As the MAVLink driver: a look before the link is opened tells that it is down."""

        def __init__(self, loop: Loop) -> None:
            self._loop = loop
            self.looked = asyncio.Event()

        async def run(self) -> None:
            self._loop.beat()
            self.looked.set()
            await asyncio.Event().wait()

    async def body(manager: NotifySocket) -> None:
        at = 100.0
        member = Unit(manager.environment(watchdog=8), lambda: at).member("bridged")
        opens, works = member.loop(), member.loop()
        driver: Any = Slow(opens)
        running = asyncio.create_task(DriverSupervisor("r", "slow", driver, print, opens).keep_apart())
        await driver.looked.wait()
        before = len(manager.fields("WATCHDOG"))
        for _ in range(10):
            at += 2
            works.beat()
        assert len(manager.fields("WATCHDOG")) == before + 10
        running.cancel()

    with NotifySocket(tmp_path / "notify") as manager:
        asyncio.run(asyncio.wait_for(body(manager), 240))


@pytest.mark.parametrize("link", ["udpout:slow.invalid:14550", "tcpin:slow.invalid:5760"])
async def test_a_link_of_an_unknown_name_is_given_up_for_now(link: str, monkeypatch: pytest.MonkeyPatch) -> None:
    async def never(*_: object, **__: object) -> None:
        await asyncio.Event().wait()

    monkeypatch.setattr(endpoints, "LOOKUP_TIMEOUT_S", 0.05)
    monkeypatch.setattr(asyncio.get_running_loop(), "getaddrinfo", never)
    with pytest.raises(LinkError, match="cannot be opened: the name service does not answer") as caught:
        await open_link(LinkAddress.parse(link), lambda *_: None, system=255, component=190)
    assert may_come(caught.value)


@pytest.mark.parametrize(
    ("error", "may"),
    [
        (FileNotFoundError(2, "no such file"), True),
        (OSError(5, "Input/output error"), True),
        (ConnectionResetError("peer reset"), True),
        (OSError("a driver's own words"), True),
        (OSError(98, "address already in use"), False),
        (OSError(25, "not a typewriter"), False),
    ],
)
def test_what_may_come_by_waiting_is_all_but_a_port_that_is_taken_and_the_like(error: OSError, may: bool) -> None:
    assert (may_come(error), may_come(_caused(error))) == (may, may)


@pytest.mark.parametrize(
    "error", [OSError("cable out"), OSError(5, "Input/output error"), ConnectionResetError("reset")]
)
async def test_a_robots_only_driver_that_loses_its_link_is_run_again_and_its_percepts_are_withdrawn(
    sonar: Any, tmp_path: Path, error: OSError, caplog: pytest.LogCaptureFixture
) -> None:
    manifest = checked(ALONE.replace('ttl = "0.3s"\n', "").replace('"0.3s"', '"30s"'))
    async with in_the_workshop(Workshop(tmp_path, manifest)) as workshop:
        await workshop.perceives("range", 2.5)
        gone: list[int] = []
        run = sonar.Sonar.run

        async def late(self: Any) -> None:
            gone.append(len(workshop.present("range")))
            await run(self)

        sonar.Sonar.run = late
        sonar.trouble.append(error)
        sonar.echo.set()
        await until(lambda: len(sonar.runs) == 2, "it is run again")
        assert gone == [0], "nothing is perceived of a robot whose link is lost"
        await workshop.perceives("range", 2.5)
        assert f"driver `sonar` does not run: {error}; it is tried again" in caplog.text


@virtual_test
async def test_a_driver_is_run_again_later_each_time_and_soon_again_once_it_has_run() -> None:
    loop, began = asyncio.get_running_loop(), list[float]()
    lasts = iter([0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0])

    async def run() -> None:
        began.append(loop.time())
        if (seconds := next(lasts, None)) is None:
            raise OSError(98, "Address already in use")
        await asyncio.sleep(seconds)
        raise ConnectionResetError("the cable is out")

    supervisor = DriverSupervisor("r1", "sonar", SimpleNamespace(run=run), Mock(), Loop.unwatched())  # type: ignore[arg-type]
    with pytest.raises(DriverError, match="driver `sonar`: run raised OSError"):
        await supervisor.keep(may_come)
    pauses = [round(after - before, 1) for before, after in pairwise(began)]
    assert pauses == [0.5, 1.0, 2.0, 4.0, 5.0, 5.5, 1.0]


@pytest.mark.parametrize("error", [KeyError("alt"), SystemExit(3), KeyboardInterrupt(), asyncio.CancelledError()])
async def test_a_defect_of_the_only_driver_names_it_and_where(sonar: Any, tmp_path: Path, error: BaseException) -> None:
    async def ends() -> None:
        raise error

    supervisor = DriverSupervisor("r1", "sonar", SimpleNamespace(run=ends), Mock(), Loop.unwatched())  # type: ignore[arg-type]
    with pytest.raises(DriverError) as caught:
        await supervisor.keep(may_come)
    said = str(caught.value)
    text = f": {error}" if str(error) else ""
    assert said.startswith(f"driver `sonar`: run raised {type(error).__name__}{text} ({__file__}:")
    assert said.endswith(", in ends)")


@pytest.mark.parametrize(
    ("value", "said"),
    [("None", "None"), ("'started'", "'started'"), ("late()", "a coroutine (it is `async def`)")],
)
async def test_a_driver_without_execution_fails_the_action(sonar: Any, tmp_path: Path, value: str, said: str) -> None:
    async def late() -> None: ...

    async with in_the_workshop(Workshop(tmp_path, checked(ALONE))) as workshop:
        sonar.Sonar.perform = lambda *_: eval(value, {"late": late})
        status = await workshop.do("ping")
        expected = f"driver `sonar`: perform returned {said}, expected an Execution"
        assert (status.state, status.reason) == ("failed", expected)


@pytest.mark.parametrize(
    ("outcome", "state", "reason"),
    [
        (Outcome("done"), "failed", "the driver ended it as 'done', expected succeeded or failed or"),  # type: ignore[arg-type]
        ("succeeded", "failed", "the driver ended it by 'succeeded', expected an Outcome"),
        (Outcome("failed", 17), "failed", "the driver's reason is no text: 17"),  # type: ignore[arg-type]
    ],
)
async def test_a_wrong_end_fails_the_action(sonar: Any, tmp_path: Path, outcome: Any, state: str, reason: str) -> None:
    async with in_the_workshop(Workshop(tmp_path, checked(ALONE))) as workshop:

        def perform(self: Any, name: str, entry: object, arguments: object) -> Execution:
            begun = Execution(name)
            asyncio.get_running_loop().call_soon(begun.end, outcome)
            return begun

        sonar.Sonar.perform = perform
        status = await workshop.do("ping")
        assert status.state == state
        assert status.reason.startswith(reason)


CHECKS = {
    "check_manifest": {
        "raise KeyError('oops')": "check_manifest raised KeyError: 'oops' (",
        "raise SystemExit(3)": "check_manifest raised SystemExit: 3 (",
        "return None": "check_manifest returned None, expected findings",
        "import threading; threading.Event().wait(60)": "check_manifest hangs: it has not ended within 0.2 s",
    },
    "check_robot": {
        "yield 1 / 0": "check_robot raised ZeroDivisionError: division by zero (",
        "return None": "check_robot returned None, expected pairs of a field and its problem",
        "return 'link is bad'": "check_robot returned 'link is bad', expected pairs of a field and its problem",
    },
    "make_driver": {
        "raise ValueError('cannot make')": "make_driver raised ValueError: cannot make (",
        "return None": "make_driver returned None, expected a driver: it has no perform, run, stop, orders",
    },
}


@pytest.mark.parametrize(
    ("function", "body", "said"), [(one, *case) for one, cases in CHECKS.items() for case in cases.items()]
)
def test_what_a_function_of_a_driver_does_wrong_names_the_driver(
    sonar: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, function: str, body: str, said: str
) -> None:
    monkeypatch.setattr("bridged.drivers.registry.PATIENCE", 0.2 if "hangs" in said else 20.0)
    space: dict[str, Any] = {}
    exec(compile(f"def {function}(_):\n    {body}", str(tmp_path / "my_sonar.py"), "exec"), space)
    manifest = checked(ALONE)
    setattr(sonar, function, space[function])
    found: list[str] = []
    match function:
        case "check_manifest":
            found = [str(one) for one in check_manifest(manifest)]
        case "check_robot":
            found = [problem for _, problem in check_robot(manifest, Robot(manifest="x"))]
        case "make_driver":
            with pytest.raises(DriverError) as caught:
                Workshop(tmp_path, manifest)
            found = [str(caught.value)]
    assert [f"driver `sonar`: {said}" in one for one in found] == [True], found
    if said.endswith("("):
        assert f"my_sonar.py:2, in {function})" in found[0]


def _caused(cause: OSError) -> LinkError:
    error = LinkError("cannot be opened")
    error.__cause__ = cause
    return error
