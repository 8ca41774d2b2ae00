"""A board whose certificate is out of date is alone, and goes on: its own daemons need none."""

import asyncio
from datetime import UTC, datetime, timedelta

import pytest

from argosy.keys.certificate_authority import Authority, Machine
from commd.bus.bus import open_bus
from schemas.wire import keys
from schemas.wire.records import Health
from tests.support.buses import until
from tests.support.secured import Secured

DAY = timedelta(days=1)


def out_of_date(fleet: Secured, board: str, made: timedelta, ends: timedelta) -> None:
    """Write keys of a board whose certificate was made, and ends, at these times from now."""
    now = datetime.now(UTC)
    authority = Authority.read((fleet.folder / "keys" / "ca.key").read_bytes(), None)
    pair = authority.at(now + made).certify(Machine("three", board, 1, True, ("127.0.0.1",)), now + ends)
    (fleet.keys(board) / "key.pem").write_bytes(pair.key)
    (fleet.keys(board) / "cert.pem").write_bytes(pair.certificate)


@pytest.mark.parametrize(
    ("made", "ends", "own", "others"),
    [
        (-30 * DAY, -DAY, "the certificate of `pi1` expired on 20", "its certificate, `pi1`, expired on 20"),
        (1000 * DAY, 1400 * DAY, "the certificate of `pi1` is valid from 20", "its certificate, `pi1`, is valid from"),
    ],
    ids=["expired", "not yet valid"],
)
def test_the_board_goes_on_alone_and_all_are_told_why(made: timedelta, ends: timedelta, own: str, others: str) -> None:
    with Secured() as fleet:
        out_of_date(fleet, "pi1", made, ends)
        for daemon in (one := fleet.start("pi1", "commd"), fleet.start("pi2", "commd")):
            daemon.says("router board=")

        async def health(board: str) -> Health:
            """The health of a board's commd as its own members hear it, once it misses a link to the other one."""
            found: list[Health] = []

            def missed() -> bool:
                notes = found[-1].notes if found else ()
                return any(note.code == "link_missing" and note.about != "pi3" for note in notes)

            async with open_bus(fleet.socket(board), fleet="three", name="x", daemon="agentd", patience=10) as bus:
                bus.subscribe(keys.health("three", board, "commd"), Health, lambda _, one: found.append(one))
                await until(missed, f"{board} misses a link")
                return found[-1]

        async def body() -> None:
            first, second = await asyncio.gather(health("pi1"), health("pi2"))
            assert first.notes[0].code == "keys_refused"
            assert first.notes[0].text.startswith(own)
            assert first.last_error.endswith(first.notes[0].text), "its log has it as an error"
            (missing,) = [note for note in second.notes if note.identity == ("link_missing", "pi1")]
            assert missing.text.startswith(f"no link to pi1: {others}")

        asyncio.run(asyncio.wait_for(body(), 240))
        assert one.process.poll() is None
        assert "other boards do not let this one in: the certificate of `pi1`" in one.text
