"""The manifest of a running bridge: changed as a whole or not at all, with every reason, and no percept lost."""

import asyncio
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridged.bridge.live_manifest import MIXED, RunningManifest
from bridged.drivers.registry import load_robot_manifest
from commd.bus.bus import Bus
from schemas.files.findings import Finding, Findings
from schemas.files.shipped_files import shipped_names
from schemas.manifest.loader import Manifest, read_document, read_manifest
from schemas.wire import keys
from schemas.wire.codec import Wire, codec
from schemas.wire.percept_set import PerceptSet
from schemas.wire.records import LiveManifest, ManifestChange, Perception
from tests.bridged.airfield import restored, serving, until

TEXT = """
[robot]
driver = "zenoh"
[percepts.pose]
source = "t/pose"
args = ["x", {field = "y", scale = 2}]
rate = 10
[actions.go]
params = [{name = "x", max = 3}, {name = "y"}]
topic = "t/go"
fields = {"linear.x" = "x"}
[orders]
hold = "go(0, 0)"
"""


class Live:
    """A running manifest and what was put into effect."""

    def __init__(self, *refuse: str) -> None:
        """`refuse`: what is raised at the first manifests that are put into effect, one after the other."""
        self.adopted: list[Manifest] = []
        self.refuse = list(refuse)
        self.running = RunningManifest(read_manifest(TEXT, "m.toml"), self.adopt)

    def adopt(self, manifest: Manifest) -> None:
        self.adopted.append(manifest)
        if self.refuse:
            raise Findings([Finding("", 0, 0, self.refuse.pop(0))])

    def change(self, *remove: str, version: int | None = None, **values: Any) -> list[str]:
        paths = {path.replace("__", "."): value for path, value in values.items()}
        return self.running.change(ManifestChange(set=paths, remove=remove, version=version))


def test_fields_elements_and_whole_entries_change_and_the_version_counts() -> None:
    live = Live()
    assert live.change(percepts__pose__rate=5, actions__go__params__x__max=4) == []
    assert live.change(actions__go__params__1__unit="m", percepts__pose__args__1__scale=1) == []
    assert live.change(percepts__speed={"source": "t/pose", "args": ["v"], "ttl": "3s"}) == []
    assert live.change("percepts.pose.rate", actions__go__retry__times=1) == []
    assert live.running.change(ManifestChange(set={'actions.go.fields."linear.y"': "y"})) == []
    now = live.running.manifest
    assert (now.percepts["pose"].rate, now.percepts["speed"].ttl) == (None, 3)
    assert [(one.max, one.unit) for one in now.actions["go"].params] == [(4, ""), (None, "m")]
    assert now.actions["go"].fields == {"linear.x": "x", "linear.y": "y"}
    assert now.actions["go"].retry.times == 1
    told = live.running.told("turtle")
    assert (told.version, told.file, told.problems) == (6, "m.toml", ())
    assert read_document(told.manifest, "").percepts == now.percepts
    assert live.adopted[-1] is now


@pytest.mark.parametrize(
    ("change", "problems"),
    [
        (
            ManifestChange(set={"percepts.pose.rate": 0, "actions.go.deadline": "soon", "percepts.pos.rate": 1}),
            [
                "percepts.pos: there is no such percept, did you mean `pose`?",
                "actions.go.deadline: expected a duration such as `5s`, `500ms` or `15min`, got `soon`",
                "percepts.pose.rate: expected a number > 0.0, got `0`",
            ],
        ),
        (
            ManifestChange(set={"actions.go.params.z.max": 1}),
            ["actions.go.params.z.max: the list has no element `z`; known are x, y"],
        ),
        (
            ManifestChange(set={"percepts.pose.args.0.scale": 1}),
            ["percepts.pose.args.0.scale: `scale` is below a single value; set that as a whole"],
        ),
        (
            ManifestChange(remove=("percepts.pose.ttl", "percepts.gps", "robots", "robot")),
            [
                "percepts.pose.ttl: there is no such field; known are args, rate, source",
                "percepts.gps: there is no such percept; known are pose",
                "robots: there is no such table, did you mean `robot`?",
                "robot: expected the path of an entry or field, such as `percepts.altitude.ttl`",
            ],
        ),
        (
            ManifestChange(remove=("actions.go",)),
            ["orders.hold: `go(0, 0)`: the manifest has no action `go`; it has none"],
        ),
        (
            ManifestChange(set={"actions.go.params": [{"name": "x"}]}),
            ["orders.hold: go(x: float) takes 1 argument, got 2"],
        ),
        (ManifestChange(set={"robot.vehicle": "boat", "robot.driver": "mavlink"}, remove=("orders",)), None),
        (ManifestChange(set={"percepts.led": {"source": "blink", "driver": "python"}}), None),
        (ManifestChange(version=7), ["the manifest is at version 1, the change is for version 7"]),
        (ManifestChange(set={"a b": 1}), ["`a b`: expected a path such as `percepts.altitude.rate`"]),
    ],
)
def test_a_change_with_anything_wrong_is_refused_whole(change: ManifestChange, problems: list[str] | None) -> None:
    live = Live()
    told = live.running.change(change)
    if problems is None:
        assert any("cannot change while the bridge runs: change the file and restart it" in one for one in told)
    else:
        assert told == problems
    assert (live.adopted, live.running.version) == ([], 1)


MISSIONS = Path(__file__).parents[3] / "missions"


@pytest.mark.parametrize(
    ("named", "folder"),
    [
        *((name, Path()) for name in shipped_names("manifests", ".toml")),
        *((("actions_manifest", "perceptions_manifest"), MISSIONS / pair) for pair in ("paper_uav", "paper_turtle")),
    ],
)
def test_every_shipped_manifest_and_the_papers_form_can_change(named: str | tuple[str, str], folder: Path) -> None:
    manifest = load_robot_manifest(named, folder)
    adopted: list[Manifest] = []
    running = RunningManifest(manifest, adopted.append)
    percept = next(iter(manifest.percepts))
    assert running.change(ManifestChange(set={f"percepts.{percept}.rate": 3})) == []
    expected = msgspec.structs.replace(manifest.percepts[percept], rate=3.0)
    assert adopted[0].percepts == manifest.percepts | {percept: expected}
    assert (adopted[0].robot, adopted[0].actions) == (manifest.robot, manifest.actions)
    assert running.told("r").file.startswith(manifest.file)


def test_what_a_driver_refuses_is_taken_back() -> None:
    live = Live("no such function `blink`")
    assert live.change(percepts__pose__rate=5) == ["no such function `blink`"]
    assert [one.percepts["pose"].rate for one in live.adopted] == [5, 10]
    assert live.running.version == 1


def test_a_manifest_that_is_not_taken_back_either_is_reported_until_a_change_is_in_effect() -> None:
    live = Live("no such function `blink`", "a defect")
    mixed = f"{MIXED}: a defect"
    assert live.change(percepts__pose__rate=5) == ["no such function `blink`", mixed]
    assert (live.running.mixed, live.running.version) == (mixed, 1)
    assert live.change(percepts__pose__rate=4) == []
    assert (live.running.mixed, live.running.version) == ("", 2)


WORDS = "robot percepts actions orders pose go args params fields x y 0 1 9 max each rate driver hold field"
STEPS = st.sampled_from(WORDS.split())
PATHS = st.one_of(st.lists(STEPS, min_size=1, max_size=6).map(".".join), st.text(max_size=5))
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | STEPS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(STEPS, inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(PATHS, VALUES, max_size=4), st.lists(PATHS, max_size=3))
def test_any_change_is_in_effect_or_refused_in_words(values: dict[str, Any], remove: list[str]) -> None:
    live = Live()
    problems = live.running.change(ManifestChange(set=values, remove=tuple(remove)))
    assert len(live.adopted) == (0 if problems else 1)
    assert all(problems)
    told = live.running.told("turtle")
    wires: tuple[Wire, ...] = ("json", "msgpack")
    for wire in wires:
        assert (
            codec(LiveManifest).decode(codec(LiveManifest).encode(told, wire), codec(LiveManifest).encodings[wire])
            == told
        )


async def ask(bus: Bus, change: ManifestChange | None) -> LiveManifest:
    async for reply in bus.query(keys.manifest("test", "uav1"), change, LiveManifest, 60):
        assert reply.record is not None, reply.error
        return reply.record
    raise AssertionError("nobody serves the manifest")


async def test_a_manifest_changes_in_flight_and_no_percept_is_lost(endpoint: str, tmp_path: Any) -> None:
    async with serving(endpoint, tmp_path) as (field, bus):
        copy, told, heard = PerceptSet(), list[LiveManifest](), list[str]()

        def hear(_key: str, one: Perception) -> None:
            copy.apply(one)
            heard.append(one.name)

        bus.subscribe(keys.percept("test", "uav", "**"), Perception, hear)
        bus.subscribe(keys.manifest("test", "uav1"), LiveManifest, lambda _key, one: told.append(one))
        await until(lambda: "altitude" in heard, "the bridge tells percepts")
        await until(lambda: restored(copy, bus), "the percepts")
        await field.take_off(bus)
        before = await ask(bus, None)
        assert (before.version, before.robot) == (1, "uav1")
        assert before.file.endswith("copter.toml")
        flying = asyncio.create_task(field.do(bus, "goto", *FAR))

        refused = await ask(
            bus,
            ManifestChange(
                set={"percepts.altitude.rate": -1, "actions.takeoff.command": "MAV_CMD_FLY"},
                remove=("actions.jump",),
            ),
        )
        assert {one.partition(":")[0] for one in refused.problems} >= {
            "actions.jump",
            "actions.takeoff.command",
            "percepts.altitude.rate",
        }
        assert (refused.version, refused.manifest) == (1, before.manifest)

        steady = {one.name: one for one in copy.present() if one.name in ("state", "home_pos")}
        life, missed = copy.boot, copy.missed
        change = ManifestChange(
            set={
                "percepts.altitude.rate": 1,
                "percepts.climb": {"source": "VFR_HUD", "args": ["climb"], "rate": 5},
                "actions.takeoff.params.altitude.max": 15,
            },
            remove=("percepts.gps",),
            version=1,
        )
        done = await ask(bus, change)
        assert (done.version, done.problems) == (2, ())
        await until(lambda: "climb" in heard, "the new percept comes")
        await until(lambda: [one.version for one in told] == [2], "observers are told")
        assert told[0].manifest == done.manifest == (await ask(bus, None)).manifest

        names = {one.name for one in copy.present()}
        assert names >= {"state", "altitude", "global_pos", "home_pos", "climb"}
        assert "gps" not in names
        assert {one.name: one for one in copy.present() if one.name in steady} == steady, "they were not told anew"
        assert (copy.boot, copy.missed, copy.needs_repair()) == (life, missed, False), "every seq came"

        heard.clear()
        await until(lambda: heard.count("global_pos") >= 30, "three mission seconds pass")
        assert heard.count("altitude") <= heard.count("global_pos") / 4, "the new rate holds"

        status = await field.do(bus, "takeoff", 20)
        assert (status.state, status.reason) == ("refused", "takeoff: expected altitude: float 1..15 m, got 20")
        assert (await flying).state == "succeeded", "what ran goes on by its old entry"


FAR = (-27.603683, -48.518052, 12)
