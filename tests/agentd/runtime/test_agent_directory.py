"""Whom the agents of a daemon know before their board's directory answers, and after."""

from __future__ import annotations

from agentd.runtime.agent_directory import AgentDirectory
from commd.bus.bus import Query
from schemas.wire import keys
from schemas.wire.records import BoardServices
from tests.support.buses import FLEET, Connect, on_a_bus, served


def test_who_had_mail_in_a_former_life_is_known_until_the_directory_answers(endpoint: str) -> None:
    async def body(connect: Connect) -> None:
        bus = await connect("a")
        roster = AgentDirectory(bus, {"a": "pi1"})
        roster.remember({"planner", "gone", "mail", "df", "a"})
        assert sorted(roster.names) == ["a", "gone", "planner"]
        directory = await connect("pi1", "commd")

        async def serve(query: Query[BoardServices]) -> None:
            header, agents = directory.header("services", "pi1"), {"planner": ()}
            said = BoardServices(header=header, board="pi1", version=1, agents=agents)
            query.reply(said, keys.services(FLEET, "pi1"))

        directory.serve(keys.services(FLEET, "pi1"), BoardServices, serve)
        await served(bus, keys.services(FLEET, "pi1"))
        await roster.watch(["pi1"])
        assert roster.names == {"a": "pi1", "planner": "pi1"}

    on_a_bus(endpoint, body)
