"""How sessions are configured, here and for a router that somebody else runs."""

import json
from pathlib import Path

import pytest
import zenoh

from commd.bus.session import session_config

SHIPPED = Path(__file__).parents[3] / "deploy" / "zenohd.json5"


@pytest.mark.parametrize(
    "key",
    [
        "mode",
        "listen/endpoints",
        "scouting/delay",
        "scouting/multicast/enabled",
        "scouting/gossip/enabled",
        "transport/link/tx/lease",
        "transport/link/tx/queue/congestion_control/block/wait_before_close",
        "transport/shared_memory/enabled",
        "adminspace",
    ],
)
def test_the_shipped_config_of_a_zenohd_is_that_of_commds_router(key: str) -> None:
    ours = session_config("router", "tcp/127.0.0.1:7447", "commd/local")
    theirs = zenoh.Config.from_file(str(SHIPPED))
    assert json.loads(theirs.get_json(key)) == json.loads(ours.get_json(key))


def test_no_session_looks_for_others_by_multicast_or_listens_beyond_what_it_is_told() -> None:
    client = session_config("client", "tcp/127.0.0.1:7447", "agentd/uav")
    assert json.loads(client.get_json("scouting/multicast/enabled")) is False
    assert json.loads(client.get_json("listen/endpoints")) == []
