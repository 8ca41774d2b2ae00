"""`argosy mail`: what waits on which board, from the daemons and from a board's file."""

import asyncio
import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from argosy.__main__ import main
from commd.bus.bus import Query
from commd.mail.inspection import mailboxes_of_file
from commd.mail.queries import MIGRATIONS
from commd.process.sqlite_file import migrate
from schemas.wire import keys
from schemas.wire.records import Mailboxes, Queue, Receipt, Refusal
from schemas.wire.terms import Atom, Structure
from tests.commd.offices import Receiver, board, message, post
from tests.support.buses import FLEET, Connect, served, until

MISSION = f"""\
mission: {FLEET}
boards: {{pi1: {{}}, pi2: {{}}}}
agents: {{}}
clients:
  a: {{board: pi1}}
  b: {{board: pi2}}
"""
AGENTS = MISSION.replace("agents: {}\nclients", "agents").replace(": {board", ": {program: a.asl, board")


@pytest.fixture
def mission(tmp_path: Path) -> str:
    """Return the mission of two boards, as a file."""
    path = tmp_path / "m.yaml"
    path.write_text(MISSION)
    return str(path)


@pytest.fixture
def of_agents(tmp_path: Path) -> str:
    """Return a mission of two agents on each of two boards, as a file."""
    path = tmp_path / "agents.yaml"
    path.write_text(AGENTS + "  c: {program: a.asl, board: pi1}\n  d: {program: a.asl, board: pi2}\n")
    return str(path)


async def argosy(*arguments: str) -> int:
    """Run the command beside the daemons of this process."""
    return await asyncio.to_thread(main, list(arguments))


def contents(folder: Path) -> dict[str, bytes]:
    return {one.name: one.read_bytes() for one in folder.iterdir()}


async def known(connect: Connect, *boards: str) -> None:
    """Wait until whoever joins now can ask these boards for their mail."""
    bus = await connect("asker")
    for one in boards:
        await served(bus, keys.mailboxes(FLEET, one))


async def test_what_waits_on_every_board_is_shown_with_its_age_and_its_reason(
    connect: Connect, endpoint: str, tmp_path: Path, mission: str, capsys: pytest.CaptureFixture[str]
) -> None:
    async with board(connect, "pi1", tmp_path) as first, board(connect, "pi2", tmp_path) as second:
        assert await post(await connect("a"), *map(message, (1, 2, 3))) == Receipt(taken=3)
        await until(lambda: second.waiting == 3 and first.waiting == 0, "all wait at the receiver's board")
        await known(connect, "pi1", "pi2")
        assert await argosy("mail", mission, "--router", endpoint) == 0
    one, two, queue = capsys.readouterr().out.splitlines()
    assert one == f"pi1: 0 messages waiting, 0 dead letters  ({tmp_path / 'pi1.mail'}, synchronous full)"
    assert two == f"pi2: 3 messages waiting, 0 dead letters  ({tmp_path / 'pi2.mail'}, synchronous full)"
    assert queue.startswith("  inbox  a > b  3 messages, ")
    assert " oldest " in queue


async def test_what_waits_within_an_agentd_is_shown_after_its_board(
    connect: Connect, endpoint: str, tmp_path: Path, mission: str, capsys: pytest.CaptureFixture[str]
) -> None:
    async with board(connect, "pi1", tmp_path), board(connect, "pi2", tmp_path):
        bus = await connect("a")

        async def listed(query: Query[Mailboxes]) -> None:
            queues = (Queue(box="mind", sender="a", receiver="c", messages=3),)
            mail = Mailboxes(header=bus.header("neighbour_mail"), board="pi1", queues=queues)
            query.reply(mail, keys.neighbour_mail(FLEET, "a"))

        bus.serve(keys.neighbour_mail(FLEET, "a"), Mailboxes, listed)
        await known(connect, "pi1", "pi2")
        await served(bus, keys.neighbour_mail(FLEET, "a"))
        assert await argosy("mail", mission, "--router", endpoint) == 0
        assert await argosy("mail", mission, "--router", endpoint, "--board", "pi2", "--json") == 0
    first, _, rest = capsys.readouterr().out.partition("{\n")
    assert first.splitlines()[1:3] == ["pi1: 3 messages waiting within the agentd of a", "  mind  a > c  3 messages"]
    assert json.loads("{\n" + rest)["agents"] == {}


async def test_agents_whose_agentd_does_not_list_its_mail_are_named_by_their_board(
    connect: Connect, endpoint: str, tmp_path: Path, of_agents: str, capsys: pytest.CaptureFixture[str]
) -> None:
    async with board(connect, "pi1", tmp_path), board(connect, "pi2", tmp_path):
        bus, hung = await connect("a", daemon="agentd"), await connect("d", daemon="agentd")
        await bus.claim_all(["a", "c"])
        await hung.claim("d")

        async def listed(query: Query[Mailboxes]) -> None:
            query.reply(Mailboxes(header=bus.header("neighbour_mail"), board="pi1"), keys.neighbour_mail(FLEET, "a"))

        bus.serve(keys.neighbour_mail(FLEET, "a"), Mailboxes, listed)
        await known(connect, "pi1", "pi2")
        await served(bus, keys.neighbour_mail(FLEET, "a"))
        assert await argosy("mail", of_agents, "--router", endpoint, "--board", "pi1") == 0
        assert await argosy("mail", of_agents, "--router", endpoint) == 1
    assert capsys.readouterr().err.splitlines() == [
        "error: pi2: the agentd of d does not answer: the mail between its agents is not shown",
        "error: pi2: the agentd of b is not running: the mail between its agents is not shown",
    ]


async def test_a_board_that_does_not_answer_is_named_and_the_others_are_shown(
    connect: Connect, endpoint: str, tmp_path: Path, mission: str, capsys: pytest.CaptureFixture[str]
) -> None:
    async with board(connect, "pi1", tmp_path):
        await known(connect, "pi1")
        assert await argosy("mail", mission, "--router", endpoint) == 1
        assert await argosy("mail", mission, "--router", endpoint, "--board", "pi1") == 0
        assert await argosy("mail", mission, "--router", endpoint, "--board", "pi2") == 1
    said = capsys.readouterr()
    assert said.err == "error: pi2: its commd does not answer\n" * 2
    assert [line.partition(":")[0] for line in said.out.splitlines()] == ["pi1", "pi1"]


async def test_dead_letters_are_counted_listed_and_told_as_json(
    connect: Connect, endpoint: str, tmp_path: Path, mission: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(_: Any) -> Receipt:
        return Receipt(refused={0: Refusal(code="not_today", text="not today")})

    async with board(connect, "pi1", tmp_path), board(connect, "pi2", tmp_path) as second:
        Receiver(await connect("b"), "b", refuse)
        await post(await connect("a"), message(1, content=Structure("victim", (Atom("north"), 3))))
        await until(lambda: second.health().counters["dead"] == 1, "it is given up")
        await known(connect, "pi1", "pi2")
        assert await argosy("mail", mission, "--router", endpoint, "--dead", "--board", "pi2") == 0
        assert await argosy("mail", mission, "--router", endpoint, "--json") == 0
    out = capsys.readouterr().out
    head, dead = out.partition("{\n")[0].splitlines()[:2]
    assert head.startswith("pi2: 0 messages waiting, 1 dead letter  (")
    assert dead.startswith("  dead  20")
    assert dead.endswith("UTC  a > b  tell victim(north,3): not today")
    told = json.loads("{\n" + out.partition("{\n")[2])
    assert [one["board"] for one in told["boards"]] == ["pi1", "pi2"]
    assert told["boards"][1]["dead"][0]["reason"] == {"code": "not_today", "text": "not today"}
    assert told["silent"] == []


async def test_a_boards_file_is_read_without_any_daemon_and_beside_it_and_not_changed(
    connect: Connect, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "pi2.mail"
    async with board(connect, "pi1", tmp_path), board(connect, "pi2", tmp_path):
        await post(await connect("a"), *map(message, (1, 2, 3)))
        await until(lambda: sum(one.messages for one in mailboxes_of_file(path).queues) == 3, "all are in the file")
        assert await argosy("mail", "--file", str(path)) == 0
    before = contents(tmp_path)
    assert await argosy("mail", "--file", str(path), "--json") == 0
    assert contents(tmp_path) == before
    out = capsys.readouterr().out
    assert out.startswith(f"pi2: 3 messages waiting, 0 dead letters  ({path})\n  inbox  a > b  3 messages, ")
    (told,) = json.loads("{\n" + out.partition("{\n")[2])["boards"]
    assert told["queues"][0]["messages"] == 3


def test_a_mail_file_whose_table_never_ends_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "pi2.mail"
    with closing(sqlite3.connect(path)) as db:
        migrate(db, MIGRATIONS)
        columns = ", ".join(f"{name!r}" for _, name, *_ in db.execute("PRAGMA table_info(mail)"))
        values = ", ".join("n" for _ in db.execute("PRAGMA table_info(mail)"))
        numbers = "WITH RECURSIVE every(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM every)"
        db.executescript(f"DROP TABLE mail; CREATE VIEW mail({columns}) AS {numbers} SELECT {values} FROM every")
    assert main(["mail", "--file", str(path)]) == 2
    assert capsys.readouterr().err.endswith("it is no board's mail: it has other tables\n")


def test_a_file_that_is_no_mail_is_told_and_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, other = tmp_path / "text.mail", tmp_path / "other.mail"
    text.write_text("this is no database, however long it is" * 100)
    sqlite3.connect(other).close()
    newer = tmp_path / "newer.mail"
    with sqlite3.connect(newer) as db:
        db.execute("CREATE TABLE mail(x)")
        db.execute("PRAGMA user_version = 99")
    db.close()
    for path, why in {
        tmp_path / "none.mail": "there is no such file",
        text: "it cannot be read as a board's mail: file is not a database",
        other: "it is no board's mail",
        newer: "it is of version 99, this is version ",
    }.items():
        assert main(["mail", "--file", str(path)]) == 2
        assert f"{path}: error: {why}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code", "problem"),
    [
        ([], 2, "expected a MISSION, or a board's database by --file"),
        (["MISSION", "--board", "pi3"], 2, "no board `pi3`, did you mean `pi2`?"),
    ],
)
def test_what_keeps_the_mail_from_being_shown_is_said(
    endpoint: str, mission: str, arguments: list[str], code: int, problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    told = [mission if argument == "MISSION" else argument for argument in arguments]
    assert main(["mail", *told, "--router", endpoint]) == code
    assert problem in capsys.readouterr().err
