"""Agents that send one another numbered messages and check those that come, and the judge of what they believe.

Every other message is a `tell`, the rest are `achieve`. A receiver knows which number of a sender is next: a smaller
one it notes as `again(S, N)`, a greater one as `gap(S, Expected, N)`. The programs do nothing to repair anything.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations

RESUMED = """\
!begin.
+!begin <- for (.member(P, PEERS)) { !!pump(P) }.

+!pump(P) : next(P, N) & limit(L) & N <= L <- !step(P, N); ?pause(T); .wait(T); !!pump(P).
+!pump(P) <- .print("sent all to ", P).
-!pump(P)[error(E), error_msg(M)] <- .print("cannot send to ", P, ": ", E, ", ", M); .wait(1000); !!pump(P).

@even[atomic] +!step(P, N) : N mod 2 == 0 <- .send(P, achieve, take(N)); -next(P, N); +next(P, N + 1).
@odd[atomic] +!step(P, N) <- .send(P, tell, item(N)); -next(P, N); +next(P, N + 1).

@told[atomic] +item(N)[source(S)] <- -item(N)[source(S)]; !check(S, N).
@asked[atomic] +!take(N)[source(S)] <- !check(S, N).
+!check(S, N) : expected(S, N) <- -expected(S, N); +expected(S, N + 1).
+!check(S, N) : expected(S, E) & N < E <- +again(S, N).
+!check(S, N) : expected(S, E) <- +gap(S, E, N); -expected(S, E); +expected(S, N + 1).
+undelivered(R, P, C, Why) <- .print("undelivered to ", R, ": ", C, ", ", Why).
"""
"""Its pending goals are posted again when it is restarted."""
DECIDING = RESUMED + "+restarted(_) <- for (.member(P, PEERS)) { !!pump(P) }.\n"
"""It decides itself what it does when it is restarted."""
_MISSION = """\
mission: letters
boards: BOARDS
agents:
{agents}
"""
_AGENT = """\
  {name}:
    program: {name}.asl
    board: {board}
    on_restart: {on_restart}
    beliefs: [{beliefs}]
"""


@dataclass(frozen=True)
class Post:
    """Who sends how many messages to whom."""

    agents: Mapping[str, str]
    """Agent to board."""
    each: int
    """Messages from each agent to each other."""
    pause: float
    """Milliseconds that a sender waits between two to the same receiver."""
    on_restart: str = "resume"

    @property
    def pairs(self) -> list[tuple[str, str]]:
        return list(permutations(self.agents, 2))

    @property
    def total(self) -> int:
        return self.each * len(self.pairs)

    def mission(self) -> str:
        """Return the text of the mission; `BOARDS` stands for its boards."""
        agents = []
        for name, board in self.agents.items():
            beliefs = [f"limit({self.each})", f"pause({self.pause:g})"]
            for other in self.agents:
                beliefs += [f"next({other}, 1)", f"expected({other}, 1)"] if other != name else []
            quoted = ", ".join(f'"{one}"' for one in beliefs)
            agents.append(_AGENT.format(name=name, board=board, on_restart=self.on_restart, beliefs=quoted))
        return _MISSION.format(agents="".join(agents))

    def programs(self) -> dict[str, str]:
        """Return the program of each agent; every other one decides itself what it does after a restart."""
        texts = {}
        for number, name in enumerate(self.agents):
            peers = f"[{', '.join(other for other in self.agents if other != name)}]"
            texts[name] = (RESUMED if number % 2 else DECIDING).replace("PEERS", peers)
        return texts


@dataclass
class Verdict:
    """What became of the messages, as the minds of all agents say."""

    sent: int = 0
    taken: int = 0
    """Messages that were taken once at least."""
    lost: int = 0
    """Messages that were sent and not taken; while some are on their way, those too."""
    duplicated: int = 0
    disordered: int = 0
    """Messages that came after one that was sent later to the same receiver."""
    details: list[str] = field(default_factory=list)

    @property
    def clean(self) -> bool:
        """Whether every message that was sent was taken once and in order."""
        return not (self.lost or self.duplicated or self.disordered)

    def __str__(self) -> str:
        return (
            f"{self.sent} sent, {self.taken} taken, {self.lost} lost, "
            f"{self.duplicated} duplicated, {self.disordered} out of order"
        )


def judge(post: Post, minds: Mapping[str, Sequence[str]]) -> Verdict:
    """Judge by the beliefs of all agents."""
    verdict = Verdict()
    for sender, receiver in post.pairs:
        sent = _number(minds[sender], f"next({receiver},") - 1
        expected = _number(minds[receiver], f"expected({sender},")
        again = _numbers(minds[receiver], f"again({sender},")
        gaps = _numbers(minds[receiver], f"gap({sender},")
        missing = {number for first, beyond in gaps for number in range(first, beyond)}
        missing.update(range(expected, sent + 1))
        late = {number for (number,) in again if number in missing}
        twice = len(again) - len(late)
        verdict.sent += sent
        verdict.taken += sent - len(missing - late)
        verdict.lost += len(missing - late)
        verdict.duplicated += twice + max(0, expected - 1 - sent)
        verdict.disordered += len(late)
        if missing or again or expected - 1 != sent:
            reported = f"{sender} to {receiver}: sent {sent}, next expected {expected}"
            verdict.details.append(f"{reported}, gaps {gaps[:5]}, again {[number for (number,) in again[:5]]}")
    return verdict


def _numbers(beliefs: Sequence[str], beginning: str) -> list[tuple[int, ...]]:
    """Return the numbers that stand behind `beginning` in each belief that begins so."""
    squeezed = (belief.replace(" ", "") for belief in beliefs)
    found = (re.match(re.escape(beginning) + r"([\d,]+)\)", belief) for belief in squeezed)
    return [tuple(map(int, match[1].split(","))) for match in found if match]


def _number(beliefs: Sequence[str], beginning: str) -> int:
    found = _numbers(beliefs, beginning)
    if len(found) != 1:
        raise AssertionError(f"one belief `{beginning}...)` was expected, found {found}")
    return found[0][0]
