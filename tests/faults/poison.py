"""The faults of what an agent is given to do: a message at which its process dies, again and again."""

import asyncio
import os
import shutil
import signal
from pathlib import Path

from agentd.persistence.poison_inputs import DEATHS, FILE, KEPT
from commd.client import join, parse
from tests.faults.mail_boards import read
from tests.faults.rows import Maker, Row
from tests.support.ports import free_port
from tests.support.processes import Daemon, running

_MISSION = """\
mission: office
agents:
  ann: {program: agent.asl}
clients: {cid: {}}
"""
_AGENT = """\
!begin.
+!begin <- .print("begun").
+!crunch <- .print("at it"); .hang.
+hello(N)[source(cid)] <- .print("heard ", N).
+set_aside(What)[source(mail)] <- .print("set aside: ", What).
"""
_COUNTING = """\
!begin.
+!begin <- .print("begun").
+restarted(N) <- .print("restarted ", N).
+say(N)[source(cid)] <- .send(cid, tell, said(N)); .print("said ", N).
+state_went_back[source(mail)] <- .print("the agent was set back").
"""
_HANGING = """\
import sys
from agentd.mind.data.registry import internal_action

@internal_action(".hang", 0)
def hang(mind, trail):
    while True:
        pass

sys.argv = ["agentd", *{arguments!r}]
from agentd.__main__ import main
sys.exit(main())
"""


def poison_message(state: Path) -> Row:
    """A message makes an agent compute for ever in a Python action; a watchdog ends its agentd each time."""
    row = Row(
        "poison message", f"real processes: an action that never returns, SIGABRT as of a watchdog, {DEATHS} starts"
    )
    (state / "agent.asl").write_text(_AGENT)
    (state / "boards.yaml").write_text(_MISSION)
    mission, endpoint = str(state / "boards.yaml"), f"tcp/127.0.0.1:{free_port()}"
    arguments = ("serve", mission, "--router", endpoint, "--state", str(state / "minds"))
    script = state / "hanging.py"
    script.write_text(_HANGING.format(arguments=list(arguments)))
    command = ("tests.faults.script", str(script))

    async def send() -> None:
        async with join("cid", mission=mission, router=endpoint, patience=30) as cid:
            await cid.send("ann", "achieve", parse("crunch"))
            await cid.send("ann", "tell", parse("hello(1)"))

    with running("commd", "serve", mission, "--router", endpoint, "--state", str(state / "mail")) as commd:
        commd.says("router board=")
        for life in range(DEATHS):
            with running(*command) as daemon:
                if not life:
                    daemon.says("begun")
                    asyncio.run(send())
                daemon.says("at it")
                _written_down(state, daemon)
                os.kill(daemon.process.pid, signal.SIGABRT)
                daemon.ends(30)
        with running(*command) as daemon:
            daemon.says("heard 1")
            daemon.says("set aside: +!crunch[source(cid)]")
            row.expect("[ann] at it" not in daemon.text, "the poison is not taken again")
            noted = [line for line in daemon.lines if "set aside, because" in line]
            row.expect(noted, "the log tells of it")
            row.seen.append(
                f'at start {DEATHS + 1} the agent takes the next message; reported: `+set_aside("+!crunch")`'
            )
        kept = next((state / "minds").rglob(KEPT)).read_text()
        row.expect("crunch" in kept, f"it is kept for inspection, found {kept}")
        row.seen.append(f"kept in `{KEPT}` beside the checkpoint")
    row.bound = "-"
    return row


def backup_restored(state: Path) -> Row:
    """The checkpoint of an agent is put back to a copy of before it has sent more mail."""
    row = Row("checkpoint that goes back in time", "real files: a copy of the agents' folder put back after kill -9")
    (state / "agent.asl").write_text(_COUNTING)
    (state / "boards.yaml").write_text(_MISSION)
    mission, endpoint = str(state / "boards.yaml"), f"tcp/127.0.0.1:{free_port()}"
    agentd = ("agentd", "serve", mission, "--router", endpoint, "--state", str(state / "minds"))

    async def talk(words: list[int]) -> list[object]:
        async with join("cid", mission=mission, router=endpoint, patience=30) as cid:
            for word in words:
                await cid.send("ann", "tell", parse(f"say({word})"))
            return await read(cid, len(words))

    with running("commd", "serve", mission, "--router", endpoint, "--state", str(state / "mail")) as commd:
        commd.says("router board=")
        with running(*agentd) as first:
            first.says("begun")
            asyncio.run(talk([1]))
        folder = next((state / "minds").rglob("*.minds")).parent
        shutil.copytree(folder, state / "copy")
        with running(*agentd) as second:
            second.says("restarted")
            asyncio.run(talk([2, 3, 4]))
            second.says("said 4")
        with running(*agentd) as third:
            third.says("restarted")
            asyncio.run(talk([5]))
            third.says("said 5")
        shutil.rmtree(folder)
        shutil.copytree(state / "copy", folder)
        with running(*agentd) as last:
            last.says("restarted")
            heard = asyncio.run(talk([6, 7]))
            row.expect(
                [getattr(one, "args", ()) for one in heard] == [(6.0,), (7.0,)], f"new mail arrives, got {heard}"
            )
            row.seen.append("what it sends then arrives: 2 of 2")
            last.says("the agent was set back")
            noted = [line for line in last.lines if "is older than what the agent has done" in line]
            row.expect(noted and "4 to cid" in noted[0], f"the log tells of it: {noted}")
            row.seen.append("reported in the log, in health (`state_went_back`) and as `+state_went_back`")
    row.bound = "-"
    return row


def _written_down(state: Path, daemon: Daemon) -> None:
    """Wait until what is in hand is written down."""
    minds = state / "minds"
    daemon.until(lambda _: any('"held"' in found.read_text() for found in minds.rglob(FILE)), "it is written down", 30)


POISON: tuple[Maker, ...] = (poison_message, backup_restored)
