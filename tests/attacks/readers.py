"""An attack by not reading, on a board whose robot is in the air."""

import asyncio
import time
from itertools import pairwise

from schemas.wire import keys
from schemas.wire.mind_records import MindView
from schemas.wire.records import Health
from tests.attacks.world import NAME, Attack, Row, World, ask, attack, health_of
from tests.support.buses import until
from tests.support.ports import free_port
from tests.support.promises import in_time, slowness
from tests.support.secured import Secured

SESSIONS = 10
SECONDS = 12.0
"""For which the attack goes on."""
AGAIN = 0.25
"""Seconds between two questions of `other`, as `argosy watch` asks."""
SILENCE = 4.0
"""Seconds that the agent may say nothing; a second later its robot is left (`agent_silence`)."""
BELIEFS = 1500
GOTO = "action=goto id="
"""What agentd says of each that has ended."""
MISSION = """
mission: three
security: {operators: [ops], observers: {eye: mail, other: mail}}
boards: BOARDS
agents:
  a: {board: pi1, program: flier.asl, robot: r1}
robots:
  r1:
    board: pi1
    manifest: copter
    agent_silence: SILENCEs
    link: udpin:127.0.0.1:PORT
    simulate: {vehicle: copter, home: [-27.604033, -48.518363, 21.0]}
"""
PROGRAM = """
!fly.
+!fly <- set_mode("GUIDED"); arm_motors(true); takeoff(10); !round(0).
+!round(N) <- .print("round ", N); goto(-27.6041, -48.5184, 12); goto(-27.6040, -48.5183, 12); !!round(N + 1).
-!round(N)[reason(R)] <- .print("left the round: ", R).
"""


@attack(
    "an observer that does not read",
    f"{SESSIONS} sessions of `eye` each ask for the mind and the trace of `a` 20 times a second for "
    f"{SECONDS:g} s, and read no answer, while `a` flies a simulated copter round two points",
    "commd of pi1: who takes nothing for 0.5 s loses the session, an observer gets none for 10 s",
)
async def silent_readers(row: Row, world: World) -> None:
    """An observer asks for much and reads nothing, while the agent flies its robot."""
    port = free_port()
    silence = 5 * slowness()
    with Secured(MISSION.replace("PORT", str(port)).replace("SILENCE", f"{silence:.0f}")) as fleet:
        places = (f'memory({place}, "what was seen at place {place} on the way").' for place in range(BELIEFS))
        (fleet.folder / "flier.asl").write_text("\n".join(places) + PROGRAM)
        of_flight = World(fleet)
        commd = fleet.start("pi1", "commd")
        await asyncio.to_thread(commd.says, "router board=")
        fleet.run("bridged", "simulate", "copter", "--link", f"udpout:127.0.0.1:{port}", "--speed", "1")
        bridged, agentd = fleet.start("pi1", "bridged"), fleet.start("pi1", "agentd")
        await asyncio.to_thread(agentd.says, "[a] round 0", 60)
        async with of_flight.member("pi1") as member, of_flight.machine("other", "pi1") as other:
            heard: list[float] = [time.monotonic()]
            member.subscribe(keys.health(NAME, "pi1", "agentd"), Health, lambda *_: heard.append(time.monotonic()))
            await until(lambda: len(heard) > 1, "the agent is heard")
            silent = ("tests.attacks.silent", fleet.link("pi1"), str(fleet.keys("eye")), f"argosy/{NAME}/a")
            attacker = fleet.run(*silent, str(SESSIONS))
            await asyncio.to_thread(attacker.says, "asking")
            mind = keys.mind(NAME, "a")
            began, asked = time.monotonic(), 0.0
            while time.monotonic() < began + SECONDS:
                at = time.monotonic()
                while not any(isinstance(one, MindView) for one in await ask(other, mind, None, MindView)):
                    await asyncio.sleep(AGAIN)
                asked = max(asked, time.monotonic() - at)
                await asyncio.sleep(AGAIN)
            row.expect(in_time(asked, SILENCE), f"`other` is answered within {SILENCE:g} s, not {asked:.1f} s")
            attacker.kill()
            flown = agentd.text.count(GOTO)
            await asyncio.to_thread(agentd.until, lambda text: text.count(GOTO) > flown, "the flight goes on", 40)
            gap = max(later - earlier for earlier, later in pairwise([*heard, time.monotonic()]))
            counters = (await health_of(member, "pi1", "commd")).counters
        row.expect(in_time(gap, SILENCE), f"the agent is heard at least every {SILENCE:g} s, not after {gap:.1f} s")
        row.expect("router lost" not in agentd.text, "the agent does not lose its router")
        row.expect("left the round" not in agentd.text, "no action fails")
        row.expect(" is lost" not in bridged.text, "the bridge does not miss its agent")
        row.expect(counters.get("stalled", 0) >= SESSIONS / 2, f"sessions that do not read are closed: {counters}")
        row.seen.append(
            f"`a` flew on, {agentd.text.count(GOTO)} `goto` succeeded, none failed; its health came {gap:.1f} s "
            "apart at most (1 s calm)"
        )
        row.seen.append(f"`other`, who reads, had each mind within {asked:.1f} s")
        reported = next((line for line in commd.lines if "does not read" in line), "")
        row.seen.append(f"health of pi1: `stalled` {counters.get('stalled', 0):g}; its log: `{reported}`")


READERS: tuple[Attack, ...] = (silent_readers,)
