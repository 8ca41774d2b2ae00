"""The Python driver: functions of installed plug-ins as percepts and actions, whatever they return, raise or forget."""

import signal
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Generator
from contextlib import AbstractAsyncContextManager
from pathlib import Path

import pytest

from bridged.drivers import registry
from bridged.drivers.python.driver import PythonDriver
from bridged.drivers.python.worker_threads import MAX_RATE, FunctionRun
from schemas.files.findings import Findings
from schemas.manifest.loader import read_manifest
from schemas.wire.records import Note
from tests.bridged.plugins import install
from tests.bridged.sky import end_of
from tests.bridged.workshop import MISSION, Workshop, checked, in_the_workshop, problems
from tests.support.buses import until
from tests.support.notes import identities
from tests.support.processes import running

GPIO = """
import threading, time

__all__ = ["button", "climb", "count", "drop", "flaky", "flood", "led", "sonar", "stuck", "stuck_once", "where"]
__all__ += ["NOT_CALLABLE"]
NOT_CALLABLE = 1
state = {"led": False, "dropped": [], "closed": [], "flaky": 0, "count": 0, "sonar": 1.5}
gate = threading.Event()

def sonar(): return state["sonar"]
def where(): return {"x": 1, "y": 2.5, "inside": True}
def count():
    state["count"] += 1
    return state["count"], [7, 8]
def flaky():
    state["flaky"] += 1
    if state["flaky"] < 4: raise OSError("no echo")
    return "ok"
def flood(): return "x" * 10_001
def stuck(): gate.wait(30)
def stuck_once():
    if not gate.is_set(): gate.wait(30)
    return 1
def button():
    try:
        for number in range(3): yield number
        gate.wait(30)
        yield "pressed"
        time.sleep(0.01)
        raise OSError("unplugged")
    finally:
        state["closed"].append("button")
def led(on, pin=0): state["led"] = (on, pin)
def drop(height, what="buoy"):
    state["dropped"].append((height, what))
    if height > 10: raise SystemExit("enough")
    if height > 9: raise RuntimeError("the hatch is frozen")
    if height > 8: return False
    if height > 7: return "too high"
    if height > 6: return 3
    return True if height > 5 else None
def climb(metres):
    try:
        for done in range(int(metres)):
            yield {"to_go": metres - done, "note": "x"}
            time.sleep(0.02)
        return None if metres < 50 else "the rope ended"
    finally:
        state["closed"].append(metres)
def hidden(): return 1
"""
TOOLS = """
[robot]
driver = "python"

[orders]
hold = "led(false)"

[percepts.range]
source = "gpio.sonar"
args = [{field = "data", scale = 100}]
rate = 50
ttl = "1s"

[percepts.where]
source = "gpio.where"
args = ["y", "inside"]

[percepts.count]
source = "gpio.count"
args = ["0", "1.1"]
rate = 50

[actions.drop]
params = [{name = "height", min = 0}]
call = "gpio.drop"
motion = false

[actions.led]
params = [{name = "on", type = "boolean"}]
call = "gpio.led"
fields = {on = "on", pin = 17}

[actions.climb]
params = [{name = "metres"}]
call = "gpio.climb"
cancel = "hold"
"""


@pytest.fixture
def gpio(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[], dict[str, object]]:
    """Install the plug-in. Returns a function that gives what it has noted, once it is imported."""
    install(monkeypatch, tmp_path, {"my_gpio": GPIO}, {"argosy.python": {"gpio": "my_gpio"}})
    return lambda: sys.modules["my_gpio"].state


def opened() -> None:
    """Let what waits in the plug-in go on."""
    sys.modules["my_gpio"].gate.set()


def robot(*entries: str, orders: str = "") -> str:
    """Return a manifest of the driver with these entries."""
    return "\n".join(['[robot]\ndriver = "python"', orders, *map(textwrap.dedent, entries)])


@pytest.fixture
def workshop(gpio: None, tmp_path: Path) -> AbstractAsyncContextManager[Workshop]:
    return in_the_workshop(Workshop(tmp_path, checked(TOOLS)))


def driver_of(workshop: Workshop) -> PythonDriver:
    driver = workshop.bridge.driver.own
    assert isinstance(driver, PythonDriver)
    return driver


async def test_values_tuples_and_dicts_are_percepts_at_the_rate_of_the_manifest(workshop: Workshop) -> None:
    await workshop.perceives("range", 150)
    await workshop.perceives("where", 2.5, True)
    await until(lambda: any(count > 3 for count, *_ in workshop.present("count")), "it counts")
    assert workshop.present("count")[0][1] == 8
    sys.modules["my_gpio"].state["sonar"] = 2
    await workshop.perceives("range", 200)
    sys.modules["my_gpio"].state["sonar"] = None  # there is no echo: the function knows it, and says so
    await workshop.perceives("range")
    assert workshop.bridge.health().counters["calls"] > 5


@pytest.mark.parametrize(
    ("height", "state", "reason"),
    [
        (1, "succeeded", ""),
        (5.5, "succeeded", ""),
        (6.5, "failed", "`gpio.drop` returned a int: expected None, True, False or a text why not"),
        (7.5, "failed", "too high"),
        (8.5, "failed", "`gpio.drop` returned False"),
        (9.5, "failed", "the hatch is frozen"),
        (10.5, "failed", "enough"),
    ],
)
async def test_what_a_function_returns_or_raises_is_the_outcome_of_its_action(
    workshop: Workshop, gpio: Callable[[], dict[str, object]], height: float, state: str, reason: str
) -> None:
    assert end_of(await workshop.do("drop", height)) == (state, reason)
    assert gpio()["dropped"] == [(height, "buoy")]
    assert (await workshop.do("drop", 1)).state == "succeeded"


async def test_fields_give_an_argument_its_constant_and_orders_are_actions(
    workshop: Workshop, gpio: Callable[[], dict[str, object]]
) -> None:
    assert (await workshop.do("led", True)).state == "succeeded"
    assert gpio()["led"] == (True, 17)
    outcome = await workshop.bridge.orders.operator("hold")
    assert outcome.state == "succeeded"
    assert gpio()["led"] == (False, 17)


async def test_a_generator_has_progress_and_a_result(workshop: Workshop, gpio: Callable[[], dict[str, object]]) -> None:
    heard = workshop.begin("climb", 60)
    await until(lambda: any(one.feedback for one in heard), "feedback")
    assert set(next(one.feedback for one in heard if one.feedback)) == {"to_go"}
    await until(lambda: heard[-1].final, "the end")
    assert (heard[-1].state, heard[-1].reason) == ("failed", "the rope ended")
    assert (await workshop.do("climb", 3)).state == "succeeded"
    assert gpio()["closed"] == [60, 3]


async def test_a_cancelled_generator_is_closed_and_its_function_can_be_called_again(
    workshop: Workshop, gpio: Callable[[], dict[str, object]]
) -> None:
    heard = workshop.begin("climb", 1000)
    await until(lambda: bool(heard) and heard[-1].state == "running", "it runs")
    assert workshop.cancel().state == "cancelled"
    await until(lambda: gpio()["closed"] == [1000], "it is closed")
    await until(
        lambda: not driver_of(workshop).refuses(workshop.bridge.action_server._manifest.actions["climb"]), "free"
    )
    assert gpio()["led"] == (False, 17)  # the manifest's hold
    assert (await workshop.do("climb", 2)).state == "succeeded"
    assert workshop.bridge.health().counters["calls_late"] == 1


async def test_each_yield_of_a_generator_is_a_reading_and_it_begins_anew_when_it_breaks(
    gpio: Callable[[], dict[str, object]], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    manifest = checked(robot('[percepts.button]\nsource = "gpio.button"\nargs = ["data"]\nbuf = "add"'))
    async with in_the_workshop(Workshop(tmp_path, manifest)) as workshop:
        await until(lambda: workshop.present("button") == [(0,), (1,), (2,)], "the first readings")
        opened()
        await until(lambda: ("pressed",) in workshop.present("button"), "the event")
        await until(
            lambda: ("function_fails", "gpio.button") in identities(workshop.bridge.health().notes), "it is told"
        )
        assert gpio()["closed"] == ["button"]
        calls = workshop.bridge.health().counters["calls"]
        await until(lambda: workshop.bridge.health().counters["calls"] > calls + 3, "it begins anew")
    assert caplog.text.count("robot=bench `gpio.button` raised OSError: unplugged") >= 1


@pytest.mark.usefixtures("gpio")
async def test_what_a_sensor_raises_is_counted_and_told_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    manifest = checked(robot('[percepts.echo]\nsource = "gpio.flaky"\nargs = ["data"]\nrate = 100'))
    async with in_the_workshop(Workshop(tmp_path, manifest)) as workshop:
        await workshop.perceives("echo", "ok")
        assert workshop.bridge.health().counters["calls_failed"] == 3
        assert workshop.bridge.health().notes == ()
    assert caplog.text.count("no echo") == 1


@pytest.mark.usefixtures("gpio")
async def test_a_reading_beyond_all_bounds_is_refused(tmp_path: Path) -> None:
    manifest = checked(robot('[percepts.much]\nsource = "gpio.flood"\nargs = ["data"]\nrate = 100'))
    async with in_the_workshop(Workshop(tmp_path, manifest)) as workshop:
        text = "`gpio.flood` fails: a reading of 10001 elements, more than 10000"
        told = Note("function_fails", text, "gpio.flood")
        await until(lambda: workshop.bridge.health().notes == (told,), "it is told")
        assert workshop.present("much") == []
        assert not workshop.bridge.driver.own.heard


@pytest.mark.usefixtures("gpio")
async def test_a_sensor_that_hangs_loses_its_percept_is_named_and_holds_up_no_other(tmp_path: Path) -> None:
    manifest = checked(
        robot(
            '[percepts.slow]\nsource = "gpio.stuck_once"\nargs = ["data"]\nrate = 20\nttl = "200ms"',
            '[percepts.count]\nsource = "gpio.count"\nargs = ["0", "1.0"]\nrate = 50',
        )
    )
    async with in_the_workshop(Workshop(tmp_path, manifest)) as workshop:
        opened()
        await workshop.perceives("slow", 1)
        sys.modules["my_gpio"].gate.clear()
        await workshop.perceives("slow")
        await until(lambda: workshop.bridge.health().counters["calls_hanging"] == 1, "it counts as hanging")
        assert identities(workshop.bridge.health().notes) == [("function_hangs", "gpio.stuck_once")]
        [before] = workshop.present("count")
        await until(lambda: workshop.present("count")[0][0] > before[0] + 5, "the other one goes on")
        opened()
        await workshop.perceives("slow", 1)
        assert workshop.bridge.health().notes == ()


@pytest.mark.usefixtures("gpio")
async def test_an_action_that_hangs_times_out_and_is_not_begun_again_meanwhile(tmp_path: Path) -> None:
    manifest = checked(robot('[actions.wait]\ncall = "gpio.stuck"\ndeadline = "200ms"\nmotion = false'))
    async with in_the_workshop(Workshop(tmp_path, manifest)) as workshop:
        final = await workshop.do("wait")
        assert final.state == "timed_out"
        assert final.reason == "not done within 0.2 s; it waited for `gpio.stuck` to return"
        again = await workshop.do("wait")
        assert again.state == "refused"
        assert again.reason.startswith("`gpio.stuck` has not returned from its last call for 0.")
        await until(lambda: bool(workshop.bridge.health().notes), "it is told")
        assert identities(workshop.bridge.health().notes) == [("function_hangs", "gpio.stuck")]
        opened()
        await until(lambda: workshop.bridge.health().counters["calls_late"] == 1, "it returned")
        assert workshop.bridge.health().notes == ()
        assert (await workshop.do("wait")).state == "succeeded"


NEVER = """
import threading
__all__ = ["read"]
def read():
    print("reading", flush=True)
    threading.Event().wait()
"""


def test_a_bridge_whose_function_never_returns_serves_on_and_can_end(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, endpoint: str
) -> None:
    install(monkeypatch, tmp_path, {"my_never": NEVER}, {"argosy.python": {"never": "my_never"}})
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "bench.toml").write_text(robot('[percepts.a]\nsource = "never.read"\nargs = ["data"]'))
    (tmp_path / "smith.asl").write_text("")
    mission = tmp_path / "workshop.yaml"
    mission.write_text(MISSION)
    with (
        running("commd", "serve", str(mission), "--router", endpoint),
        running(*("bridged", "serve", str(mission), "bench", "--router", endpoint, "--state", str(tmp_path))) as bridge,
    ):
        bridge.says("serving bench")
        bridge.says("reading")
        bridge.signal(signal.SIGTERM)
        assert bridge.ends(25) == 0
        assert "leaving bench" in bridge.text
        assert "Traceback" not in bridge.text


@pytest.mark.usefixtures("gpio")
def test_what_a_manifest_names_and_no_plug_in_offers_is_told_at_its_line_with_what_there_is(tmp_path: Path) -> None:
    offered = "button, climb, count, drop, flaky, flood, led, sonar, stuck, stuck_once, where"
    assert problems(
        robot(
            '[percepts.a]\nsource = "gpio.hidden"',
            '[percepts.b]\nsource = "serial.read"',
            '[percepts.c]\nsource = "sonar"',
            '[percepts.d]\nsource = "gpio.state.clear"',
            '[percepts.e]\nsource = "gpio.led"',
            '[actions.f]\ncall = "gpio.drop"\nparams = [{name = "altitude"}]\ncancel = "hold"\nframe = "amsl"',
        )
    ) == [
        f"bench.toml:5: error: percepts.a.source: the plug-in `gpio` offers no `hidden`; in its `__all__` there is "
        f"{offered}",
        "bench.toml:7: error: percepts.b.source: no plug-in `serial` is installed (entry points of `argosy.python`); "
        "there is gpio",
        "bench.toml:9: error: percepts.c.source: expected PLUGIN.FUNCTION, such as `gpio.sonar`, got `sonar`",
        "bench.toml:11: error: percepts.d.source: expected PLUGIN.FUNCTION, such as `gpio.sonar`, got "
        "`gpio.state.clear`",
        "bench.toml:13: error: percepts.e.source: `gpio.led` is to be called with nothing: missing a required "
        "argument: 'on': it is led(on, pin=0)",
        "bench.toml:15: error: actions.f.call: `gpio.drop` is to be called with altitude: missing a required argument: "
        "'height': it is drop(height, what='buoy')",
        "bench.toml:18: error: actions.f.frame: the driver `python` has no `frame`",
        "bench.toml:17: error: actions.f.cancel: the driver `python` cannot hold by itself: expected `hold` in "
        "`[orders]`",
    ]


def test_an_unimportable_plug_in_is_told_with_its_package(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    install(monkeypatch, tmp_path, {"my_sick": "import no_such_library"}, {"argosy.python": {"sick": "my_sick"}})
    assert problems(robot('[percepts.a]\nsource = "sick.read"')) == [
        "bench.toml:5: error: percepts.a.source: the plug-in `sick` of my-robot 1.2 cannot be imported: "
        "ModuleNotFoundError: No module named 'no_such_library'"
    ]


REAL = "import no_such_hardware\n__all__ = ['read']\ndef read(): return 'real'\n"
TWIN = "__all__ = ['read']\ndef read(): return 'twin'\n"
READS = '[percepts.a]\nsource = "probe.read"\nargs = ["data"]\nrate = 20'


async def test_a_simulated_robot_has_the_functions_of_the_twin_and_needs_no_hardware(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    entries = {"argosy.python": {"probe": "my_probe"}, "argosy.python.simulated": {"probe": "my_probe_twin"}}
    install(monkeypatch, tmp_path, {"my_probe": REAL, "my_probe_twin": TWIN}, entries)
    manifest = checked(robot(READS))
    async with in_the_workshop(Workshop(tmp_path, manifest, simulated=True)) as workshop:
        await workshop.perceives("a", "twin")
    with pytest.raises(Findings, match=r"the plug-in `probe` of my-robot 1\.2 cannot be imported: ModuleNotFoundError"):
        Workshop(tmp_path, manifest)


def test_a_plug_in_without_a_twin_is_told_when_simulated(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    install(monkeypatch, tmp_path, {"my_plain": TWIN}, {"argosy.python": {"probe": "my_plain"}})
    told = r"bench\.toml:5: error: percepts\.a\.source: the plug-in `probe` cannot be simulated: no entry point of"
    with pytest.raises(Findings, match=told):
        Workshop(tmp_path, checked(robot(READS)), simulated=True)


async def test_another_manifest_is_taken_over_without_losing_a_percept(workshop: Workshop) -> None:
    await workshop.perceives("range", 150)
    other = TOOLS.replace("rate = 50\nttl", "rate = 100\nttl").replace("[percepts.where]", "[percepts.position]")
    changed = read_manifest(other, "bench.toml")
    workshop.bridge.driver.adopt(changed)
    calls = workshop.bridge.health().counters["calls"]
    await until(lambda: workshop.bridge.health().counters["calls"] > calls + 10, "it goes on")
    assert workshop.present("range") == [(150,)]
    with pytest.raises(Findings, match="offers no `sonnar`"):
        workshop.bridge.driver.adopt(read_manifest(TOOLS.replace("gpio.sonar", "gpio.sonnar"), "bench.toml"))


def test_a_plug_in_whose_import_does_not_end_is_a_finding_within_a_bound(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(registry, "PATIENCE", 0.3)
    caplog.set_level("INFO")
    install(
        monkeypatch,
        tmp_path,
        {"my_stuck": "import threading\nthreading.Event().wait(20)\n"},
        {"argosy.python": {"stuck": "my_stuck"}},
    )
    said = problems(robot('[actions.go]\ncall = "stuck.go"'))
    assert any("cannot be imported: TimeoutError: it has not ended within 0.3 s" in one for one in said), said
    assert "importing my_stuck, which `stuck` names" in caplog.text


async def test_the_thread_of_a_function_that_is_named_no_more_ends(
    gpio: Callable[[], dict[str, object]], tmp_path: Path
) -> None:
    text = robot('[percepts.count]\nsource = "gpio.count"\nargs = ["0"]', '[actions.led]\ncall = "gpio.drop"')
    text = text.replace('call = "gpio.drop"', 'call = "gpio.drop"\nparams = [{name = "height"}]')

    def threads() -> set[str]:
        return {one.name for one in threading.enumerate()} & {"gpio.count", "gpio.drop"}

    async with in_the_workshop(Workshop(tmp_path, checked(text))) as workshop:
        await workshop.do("led", 1.0)
        await until(lambda: threads() == {"gpio.count", "gpio.drop"}, "both are called")
        workshop.bridge.driver.adopt(checked(text[: text.index("[actions")]))
        await until(lambda: threads() == {"gpio.count"}, "the thread of the action ends")
        workshop.bridge.driver.adopt(checked(text))
        assert (await workshop.do("led", 1.0)).state == "succeeded"


def test_a_generator_that_does_not_pause_is_asked_at_a_bounded_rate() -> None:
    asked = []

    def eager() -> Generator[dict[str, int], None, None]:
        for number in range(50):
            asked.append(time.monotonic())
            yield {"to_go": number}

    FunctionRun("go", "x.go").work(eager, {})
    assert asked[-1] - asked[0] >= 49 / MAX_RATE
