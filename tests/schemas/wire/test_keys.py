"""The one table of key expressions, its builders, and the page that shows it."""

import re
from pathlib import Path

import pytest

from schemas.wire import keys
from schemas.wire.keys import check_name

PAGE = Path(__file__).parents[3] / "docs/reference/bus-keys.md"

BUILT = {
    keys.percepts("{fleet}", "{agent}"),
    keys.percept("{fleet}", "{agent}", "{name}"),
    keys.percept_by_hand("{fleet}", "{agent}", "{name}"),
    keys.percept("{fleet}", "{agent}", "**"),
    keys.action("{fleet}", "{agent}", "{name}"),
    keys.cancel("{fleet}", "{agent}"),
    keys.status("{fleet}", "{agent}", "{name}"),
    keys.outbox("{fleet}", "{agent}"),
    keys.inbox("{fleet}", "{agent}"),
    keys.mail("{fleet}", "{receiver}", "{sender}"),
    keys.trace("{fleet}", "{agent}", "inputs"),
    keys.trace("{fleet}", "{agent}", "decisions"),
    keys.trace("{fleet}", "{agent}", "activity"),
    keys.control("{fleet}", "{agent}"),
    keys.services("{fleet}", "{board}"),
    keys.service_requests("{fleet}", "{board}", "{agent}"),
    keys.mailboxes("{fleet}", "{board}"),
    keys.neighbour_mail("{fleet}", "{agent}"),
    keys.mission("{fleet}", "{board}"),
    keys.checkup("{fleet}", "{board}"),
    keys.mind("{fleet}", "{agent}"),
    keys.manifest("{fleet}", "{robot}"),
    keys.parameters("{fleet}", "{robot}"),
    keys.stored_plan("{fleet}", "{robot}"),
    keys.stop("{fleet}", "{robot}"),
    keys.run("{fleet}", "{operator}"),
    keys.alive("{fleet}", "{name}", "{daemon}", "{boot}"),
    keys.health("{fleet}", "{name}", "{daemon}"),
}


def test_the_builders_make_the_keys_of_the_table_and_no_others() -> None:
    assert {f"argosy/{{fleet}}/{channel.key}" for channel in keys.CHANNELS} == BUILT


def test_the_page_shows_the_table_as_it_is() -> None:
    rows = []
    for channel in keys.CHANNELS:
        carries = channel.carries.__name__ if channel.carries else ""
        answers = channel.answers.__name__ if channel.answers else ""
        rate = f"{channel.rate:g} Hz" if channel.rate else ""
        cells = [f"`{channel.key}`", channel.kind, carries, answers, channel.source, channel.sink, rate]
        cells.append(channel.sight or "")
        rows.append(re.sub(r" +", " ", "| " + " | ".join(cells) + " |"))
    shown = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `{")]
    assert shown == rows


def test_keys_split_into_fleet_name_and_rest() -> None:
    assert keys.parse("argosy/sar/uav/percept/altitude") == ("sar", "uav", ["percept", "altitude"])
    assert keys.parse("other/sar/uav/percept") is None
    assert keys.parse("argosy/sar") is None


@pytest.mark.parametrize("name", ["", "a/b", "a*", "$x", "a?b", "#", "1a", "a b", "ä", "x" * 65, "a\n"])
def test_a_name_that_is_no_single_plain_chunk_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="Expected a name of letters"):
        check_name(name)
