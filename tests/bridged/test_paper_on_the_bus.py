"""One pair of the paper's manifests, of which a part is a copter on UDP and a part a lamp on Zenoh keys."""

import json
from pathlib import Path

from commd.bus.bus import Bus
from schemas.wire import keys
from schemas.wire.records import Perception
from schemas.wire.terms import Atom, Variable
from tests.bridged.airfield import present, serving, until
from tests.bridged.sky import MISSION
from tests.support.buses import subscribed

ACTIONS = """
[set_mode]
method = service
name = uav1/mavros/set_mode
params_name = custom_mode

[light]
method = topic
name = /lamp/set
msg_type = std_msgs/ColorRGBA
params_name = on, colour.name, levels
params_type = bool, str, int[],

[dim]
method = service
name = /lamp/dim
params_name = percent
params_type = int
"""
PERCEPTS = """
[DEFAULT]
rate = 20

[state]
name = /uav1/mavros/state
args = mode, connected, armed

[lamp]
name = /lamp/state
args = on, mood, parts[](name, values[](key, value))
"""


async def perceived(bus: Bus, name: str) -> tuple[object, ...] | None:
    """What an agent perceives now under a name."""
    found = [one.record for one in await present(bus) if one.record is not None and one.record.name == name]
    return found[0].parameters if found else None


async def test_a_pair_may_be_of_a_copter_and_of_something_on_zenoh(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "actions").write_text(ACTIONS)
    (tmp_path / "percepts").write_text(PERCEPTS)
    pair = f"[{tmp_path / 'actions'}, {tmp_path / 'percepts'}]"
    mission = MISSION.replace("manifest: copter", f"manifest: {pair}\n    prefix: house")
    told: list[object] = []
    async with serving(endpoint, tmp_path, mission=mission) as (field, bus), field.client("house") as lamp:
        lamp.raw.subscribe("house/lamp/set", lambda sample: told.append(json.loads(sample.payload)))
        assert (await field.do(bus, "set_mode", "GUIDED")).state == "succeeded"
        assert await perceived(bus, "state") == ("GUIDED", "True", "False")
        heard: list[Perception] = []
        bus.subscribe(keys.percept("test", "uav", "**"), Perception, lambda _key, one: heard.append(one))

        async def lit() -> bool:
            return (await field.do(bus, "light", Variable("True"), Atom("red"), [1, 2])).state == "succeeded"

        await until(lit, "the bridge knows that the lamp listens")
        await until(lambda: bool(told), "the lamp is told")
        assert told == [{"on": True, "colour": {"name": "red"}, "levels": [1, 2]}]
        await subscribed(lamp, "house/lamp/state")
        state = {"on": False, "mood": "calm", "parts": [{"name": "A", "values": [{"key": "k", "value": "7"}]}]}
        lamp.raw.publisher("house/lamp/state").put(json.dumps(state).encode(), "application/json")
        await until(lambda: any(one.name == "lamp" for one in heard), "the lamp's percept")
        assert await perceived(bus, "lamp") == ("False", Atom("calm"), [["A", [[Atom("k"), 7]]]])
        refused = await field.do(bus, "dim", 50)
        assert (refused.state, refused.result) == ("failed", False), "nobody serves it"
