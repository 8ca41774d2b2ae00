"""What comes to a busy bridge together is carried out in the order in which it came."""

import asyncio
import time
from typing import TypeVar

from schemas.wire import keys
from schemas.wire.records import Action, ActionStatus, Cancel, LiveManifest, ManifestChange, Outcome, Record, StopOrder
from tests.bridged.studio import Studio
from tests.support.buses import served, until

R = TypeVar("R", bound=Record)
BUSY = 0.5
"""Wall seconds for which the bridge does not come to what is asked."""


def command(studio: Studio, identity: str, ahead: float = 1.0) -> Action:
    return Action(
        header=studio.bus.header("action", studio.agent), id=f"{studio.agent}:busy:{identity}", parameters=(ahead, 0, 0)
    )


async def asked(studio: Studio, key: str, ask: Record, answer: type[R]) -> R:
    """Ask and return the last answer."""
    replies = [one async for one in studio.bus.query(key, ask, answer, 20)]
    assert replies, f"nobody serves {key}"
    assert replies[-1].record is not None, replies[-1].error
    return replies[-1].record


async def together(studio: Studio, *asks: tuple[str, Record]) -> list[Record]:
    """Ask one after the other while the bridge is busy, so that it finds all of it when it comes to it."""
    answers: dict[type[Record], type[Record]] = {
        Action: ActionStatus,
        Cancel: ActionStatus,
        StopOrder: Outcome,
        ManifestChange: LiveManifest,
    }
    asking = [asyncio.create_task(asked(studio, key, ask, answers[type(ask)])) for key, ask in asks]
    asyncio.get_running_loop().call_soon(time.sleep, BUSY)  # the bridge lives on the same loop
    return await asyncio.gather(*asking)


async def ready(studio: Studio) -> tuple[str, str]:
    """Wait until the turtle is driven; return the keys of its command and of its stop."""
    fleet = studio.bus.fleet
    act, stop = keys.action(fleet, studio.agent, "cmd_vel"), keys.stop(fleet, studio.robot)
    for key in (act, stop, keys.cancel(fleet, studio.agent), keys.manifest(fleet, studio.robot)):
        await served(studio.bus, key)
    await until(lambda: bool(studio.values("pose")), "its pose is perceived")
    return act, stop


async def test_an_action_that_comes_behind_a_stop_is_refused_and_one_behind_a_release_begins(studio: Studio) -> None:
    act, stop = await ready(studio)
    hold, release = StopOrder(order="hold"), StopOrder(order="release")
    outcome, status = await together(studio, (stop, hold), (act, command(studio, "1")))
    assert outcome.ok, outcome.reason
    assert (status.state, status.cause, status.order) == ("refused", "operator", "hold")
    outcome, status = await together(studio, (stop, release), (act, command(studio, "2")))
    assert status.state == "succeeded", status.reason
    outcomes = await together(studio, (stop, hold), (stop, release))
    assert [one.ok for one in outcomes] == [True, True]
    assert (await studio.do("cmd_vel", 1, 0, 0)).state == "succeeded", "the release came last"
    outcomes = await together(studio, (stop, release), (stop, hold))
    assert (await studio.do("cmd_vel", 1, 0, 0)).cause == "operator", "the stop came last"


async def test_an_action_that_comes_behind_a_change_of_the_manifest_is_judged_by_the_new_one(studio: Studio) -> None:
    act, _ = await ready(studio)
    change = ManifestChange(set={"actions.cmd_vel.params.ahead.max": 2})
    manifest = keys.manifest(studio.bus.fleet, studio.robot)
    changed, status = await together(studio, (manifest, change), (act, command(studio, "1", 3)))
    assert changed.problems == ()
    assert (status.state, "2" in status.reason) == ("refused", True), status


async def test_an_action_that_comes_behind_the_cancel_of_another_does_not_find_it_running(studio: Studio) -> None:
    await ready(studio)
    studio.leave.set()
    await until(lambda: not studio.values("pose"), "the turtle does not answer any more")
    teleport = keys.action(studio.bus.fleet, studio.agent, "teleport")
    first = asyncio.create_task(asked(studio, teleport, command(studio, "1"), ActionStatus))
    cancel = Cancel(header=studio.bus.header("cancel", studio.agent), id=f"{studio.agent}:busy:1")
    _, status = await together(
        studio, (keys.cancel(studio.bus.fleet, studio.agent), cancel), (teleport, command(studio, "2"))
    )
    assert "busy" not in status.reason
    assert (await first).state == "cancelled"
