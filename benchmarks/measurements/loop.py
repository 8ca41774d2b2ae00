"""Part `loop`: the decision loop percept -> belief -> plan -> action -> status, through the real daemons.

The loop goes from the robot's sample to the agent's next action at the robot. It is compared with bare Zenoh exchanges
of the same sizes, between two Python processes through the same router, in turn with the loop. It contains:

1. sample to the bridge, percept to the agent, next action's request: as a bare put and its being put back;
2. action to the bridge, status to the agent: as a bare query and its reply.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Final

import msgspec

from benchmarks.health import DAEMONS, Records, grown, listening
from benchmarks.measurements.loop_board import Board, Sizes, board, payload, raw
from benchmarks.parts import Goal, at_least, row, table
from benchmarks.processes import BenchmarkFailed, until
from benchmarks.results import Origin
from benchmarks.spread import percentile
from schemas.wire import records as wire
from schemas.wire.records import Action, ActionStatus, Header, Perception

PAUSE: Final = 0.008
"""Seconds between two exchanges: what one leaves to be done (an id synced to the disk) must not slow the next."""
WARM_UP: Final = 50
TURNS: Final = 1000
RATES: Final = (1050.0, 2000.0, 3000.0, 4000.0, 6000.0)
"""Changes a second, until some are lost; the first is a little above the goal, as no sender is quite in time."""
GOAL_TIMES, GOAL_RATE = 4.0, 1000.0
GOAL_STATUS, GOAL_STATUS_TIMES = 4.0, 2.2
"""Milliseconds from the robot's sample to the status of the action, p50, and times the bare exchanges in it."""
CONTAINS: Final = {"seen": (1.5, 1.5), "pong": (1.5, 0.5), "status": (1.5, 0.5)}
"""Bare puts and queries, there and back, that are in a part of the loop."""
_NOTES: Final = f"""\
* The robot is a process on Zenoh keys, the plan is `+ping(N) <- pong(N); seen(N).`. The loop goes from the moment
  before the robot puts a sample (`ping(N)`) to the arrival of an action there: `pong` first, `seen` after the final
  status of `pong`. A way counts as half of its bare exchange. The bare put carries a percept's bytes both ways; the
  sample is smaller.
* *Times* are percentiles of the loop over those of what the bare exchanges of each turn take together.
* There is a pause of {1000 * PAUSE:g} ms between two exchanges: what a decision leaves to be done, as to sync the id
  of its action to the disk, is over when the next begins."""
PERCENTILES: Final = (0.5, 0.99, 1.0)


@dataclass
class Turns:
    """What one run measured, us, turn by turn."""

    put: list[float] = field(default_factory=list)
    """A put and a put back."""
    ask: list[float] = field(default_factory=list)
    """A query and its reply."""
    pong: list[float] = field(default_factory=list)
    """From the robot's sample to the action of its agent at the robot."""
    seen: list[float] = field(default_factory=list)
    """From the robot's sample to the next action of the plan at the robot."""
    status: list[float] = field(default_factory=list)
    """From the robot's sample to the status that the bridge publishes of the agent's action."""
    cpu: dict[str, float] = field(default_factory=dict)
    """Processor time of bridge and agent for a turn."""


def sizes() -> Sizes:
    """Return the bytes of the loop's records, as they are encoded."""
    header = Header(seq=1000, stamp=time.time_ns(), source="thinker", boot="0123abcd")
    identity = f"thinker:{header.boot}:1000"
    percept = Perception(header=header, name="ping", parameters=(1000,), update="replace")
    together = getattr(wire, "Perceptions", None)  # an earlier revision has none
    records = (
        percept if together is None else together(changes=(percept,)),
        Action(header=header, id=identity, agent="thinker", name="pong", parameters=(1000,)),
        ActionStatus(
            header=header, id=identity, state="succeeded", result=True, after=1000, name="pong", parameters=(1000,)
        ),
    )
    return Sizes(len(payload(1000)), *(len(msgspec.json.encode(record)) for record in records))


def turn(turns: int, *, kept: bool = True) -> Turns:
    """Run the loop and the bare exchanges so often, one after the other. Raises BenchmarkFailed."""
    found = Turns()
    with board(kept=kept) as ours, raw(ours.endpoint, ours.session, sizes()) as bare:
        for number in range(1, WARM_UP + 1):
            bare.put_and_back()
            bare.ask()
            _loop(ours, number)
        daemons = (ours.bridge, ours.agent)
        used = {one.name: one.cpu() for one in daemons}
        for number in range(WARM_UP + 1, WARM_UP + turns + 1):
            found.put.append(bare.put_and_back() / 1000)
            time.sleep(PAUSE)
            found.ask.append(bare.ask() / 1000)
            time.sleep(PAUSE)
            for times, took in zip((found.pong, found.seen, found.status), _loop(ours, number), strict=True):
                times.append(took)
            time.sleep(PAUSE)
        found.cpu = {one.name: 1e6 * (one.cpu() - used[one.name]) / turns for one in daemons}
    return found


def _loop(ours: Board, number: int) -> list[float]:
    """Run the loop once. Returns microseconds from the sample to both actions and the first one's status.

    Raises BenchmarkFailed.
    """
    begun = time.monotonic_ns()
    ours.put("ping", number)
    came = [one.when(number) for one in (ours.pong, ours.seen, ours.status)]
    if None in came:
        raise BenchmarkFailed(f"ping({number}) was not answered; last:\n{ours.last_words()}")
    return [(at - begun) / 1000 for at in came if at is not None]


SECONDS: Final = 4.0
"""For which a rate is kept up."""
KEEPS_UP: Final = 1.0
"""Seconds after the last change within which the last event has to be there."""
UNDER_WAY: Final = 0.3
"""Seconds that a daemon's figures may be old when they come."""
MADE: Final = 0.98
"""Of the changes a second that are wanted so many have to be made: by less the rate was not tried."""
GONE: Final = 8.0
"""Seconds after which events do not come any more."""
_LOST: Final = ("drops", "bad_input", "percepts_missed", "samples_dropped", "percepts_unreadable")
"""Figures of the daemons' health that must stay 0. `drops` includes what a set of percepts drops for lack of room."""


@dataclass
class Flood:
    """One run."""

    rate: float
    """Changes a second that were wanted."""
    reached: float
    """That were made."""
    changes: int
    heard: int
    """Belief events that came, as the program has counted them."""
    behind: float
    """Seconds from the last change to the line that the program prints for the last event; -1: it never came."""
    lost: dict[str, float] = field(default_factory=dict)
    """Of the daemons' counters of what is lost those that are not 0."""
    disorder: list[str] = field(default_factory=list)
    """What the program printed came instead of what; the first lines."""
    cpu: dict[str, float] = field(default_factory=dict)
    """Per cent of a core, of each daemon, up to the last event."""

    @property
    def made(self) -> float:
        """Changes a second that count: those that were made, and no more than were wanted."""
        return min(self.rate, self.reached)

    @property
    def in_time(self) -> bool:
        """Whether the sender made the rate that was wanted."""
        return self.reached >= MADE * self.rate

    @property
    def complete(self) -> bool:
        """Whether each change made its event, in order, and nothing is counted as lost."""
        return self.heard == self.changes and not self.lost and not self.disorder

    @property
    def kept_up(self) -> bool:
        """Whether that was at the rate that was wanted, and the agent was not left behind either."""
        return self.in_time and self.complete and 0 <= self.behind <= KEEPS_UP


def flood(rate: float, source: str = "tick", seconds: float = SECONDS) -> Flood:
    """Let the robot change so often a second, on a board of its own. Raises BenchmarkFailed."""
    with board() as ours, listening(ours.endpoint, "loop") as records:
        return _flood(ours, records, source, rate, seconds)


def _flood(ours: Board, records: Records, source: str, rate: float, seconds: float) -> Flood:
    _rest(records)
    count, lines = round(rate * seconds), len(ours.agent.output)
    daemons = (ours.router, ours.bridge, ours.agent)
    used = {one.name: one.cpu() for one in daemons}
    begun = time.monotonic()
    for index in range(1, count + 1):
        if (wait := begun + index / rate - time.monotonic()) > 0:
            time.sleep(wait)
        ours.put(source, index, count)
    ended = time.monotonic()

    def done() -> float:
        return ours.agent.when(f"all up to {count}", lines)

    until(lambda: bool(done()), GONE)
    spent = time.monotonic() - begun
    cpu = {one.name: 100 * (one.cpu() - used[one.name]) / spent for one in daemons}
    ours.put("run", 1)
    counted = "run 1 is at "
    until(lambda: bool(ours.agent.when(counted, lines)), GONE)
    _rest(records)
    lost = grown(records, begun, time.monotonic())
    printed = [line for _, line in ours.agent.output[lines:]]
    heard = [int(at) - 1 - int(less) for at, less in re.findall(rf"{counted}(\d+) without (-?\d+)", "\n".join(printed))]
    return Flood(
        rate=rate,
        reached=count / (ended - begun),
        changes=count,
        heard=heard[0] if heard else 0,
        behind=done() - ended if done() else -1.0,
        lost={
            f"{kind}: {name}": lost[kind].counts[name] for kind in DAEMONS for name in _LOST if lost[kind].counts[name]
        },
        disorder=[line for line in printed if " instead of " in line][:5],
        cpu=cpu,
    )


def _rest(records: Records) -> None:
    """Wait until bridge and agent have published figures that include everything until now."""
    now = time.monotonic()

    def published() -> bool:
        at = records.last()
        return len(at) > 1 and all(moment > now + UNDER_WAY for moment in at.values())

    if not until(published, GONE):
        raise BenchmarkFailed(f"no figures of bridge and agent within {GONE:g} s")


@dataclass
class Figures:
    """What one run measured."""

    bytes: dict[str, int]
    kept: Turns
    """An agent that is kept on disk, which is the default."""
    fresh: Turns
    """An agent with `on_restart: fresh`: no action is written down before its request."""
    replaced: list[Flood]
    added: list[Flood]


def measure(quick: bool) -> Figures:
    """Run everything once. Raises BenchmarkFailed."""
    count, seconds = (20, 0.5) if quick else (TURNS, SECONDS)
    carried = sizes()
    return Figures(
        bytes={"percept": carried.perception, "action": carried.action, "status": carried.status},
        kept=turn(count),
        fresh=turn(count, kept=False),
        replaced=list(_floods("tick", [100.0] if quick else RATES, seconds)),
        added=list(_floods("mark", [100.0] if quick else RATES, seconds)),
    )


def probe(quick: bool) -> dict[str, float]:
    """Return what a turn of the loop and a percept cost: less is better."""
    found: dict[str, float] = {}
    for title, kept in (("agent kept on disk", True), ("agent not kept", False)):
        turns = turn(10 if quick else 300, kept=kept)
        found[f"sample to next action, {title}, p50 (µs)"] = median(turns.seen)
        found[f"sample to status, {title}, p50 (µs)"] = median(turns.status)
        found |= {f"a turn, {title}, processor time of {name} (µs)": used for name, used in turns.cpu.items()}
    for source, title in (("tick", "replaced"), ("mark", "added")):
        run = flood(100.0 if quick else 500.0, source, 0.5 if quick else 6.0)
        if not run.complete:
            raise BenchmarkFailed(f"of {run.changes} percepts {run.heard} came")
        for name in ("agentd", "bridged"):
            found[f"percept {title}, processor time of {name} (µs)"] = 1e4 * run.cpu[name] / run.made
    return found


def _floods(source: str, rates: Sequence[float], seconds: float) -> Iterator[Flood]:
    """Raise the rate until changes are lost."""
    for rate in rates:
        found = flood(rate, source, seconds)
        yield found
        if not found.kept_up:
            return


def times(turns: Turns, part: float = 0.5, *, ways: str = "seen") -> float:
    """Return how often the bare exchanges that the loop contains fit into it, at a percentile.

    The bare ones of a turn are added up before their percentile is taken: the sum of two worst cases would be too kind.
    `ways`: `seen` up to the next action at the robot, `pong` up to the first one, `status` up to the status of that.
    """
    puts, asks = CONTAINS[ways]
    bare = [puts * put + asks * ask for put, ask in zip(turns.put, turns.ask, strict=True)]
    return percentile(getattr(turns, ways), part) / percentile(bare, part)


def fastest(floods: list[Flood]) -> Flood | None:
    """Return the run of the highest rate at which nothing was lost."""
    return max((one for one in floods if one.kept_up), key=lambda one: one.made, default=None)


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of the figures."""
    ratio = times(figures.kept)
    title = "percept → belief → plan → action → status → next action at the robot, p50"
    wanted = f"< {GOAL_TIMES:g} times the bare exchanges in it, at p50"
    found = f"{ratio:.1f} times (at p99 {times(figures.kept, 0.99):.1f})"
    made = [Goal(title, wanted, found, ratio < GOAL_TIMES, f"{_WHERE}; {_TRIED}")]
    if figures.kept.status:
        status, of_bare = median(figures.kept.status) / 1000, times(figures.kept, ways="status")
        title = "percept → belief → plan → action → status on the bus, p50"
        wanted = f"{GOAL_STATUS:g} ms, {GOAL_STATUS_TIMES:g} times the bare exchanges in it"
        met = status <= GOAL_STATUS and of_bare <= GOAL_STATUS_TIMES
        made.append(Goal(title, wanted, f"{status:.1f} ms, {of_bare:.1f} times", met, f"{_WHERE}; {_TRIED}"))
    for what, floods in (("replaced", figures.replaced), ("added", figures.added)):
        best = fastest(floods)
        title = f"percepts a second that are {what}, for one agent, none lost"
        made.append(at_least(title, GOAL_RATE, best.made if best else 0.0, why=_loss(floods)))
    return made


_WHERE: Final = (
    "by stamps within the daemons, two busy cores, of 4.2 ms up to the status: robot to bridge 0.5, percept made and "
    "put 0.3, to the mind 0.2, its turn 0.4, the commit of the action's id (a thread, an fsync) 0.6, the query 0.7, "
    "the action 0.4, answer and status put 0.5, to the observer 0.6"
)
_TRIED: Final = (
    "tried: keys are declared once, a percept takes one pass of the agent's event loop, the bridge answers the asker "
    "first and puts the status right behind it (0.6 ms less), one thread of Zenoh's for what comes in (no difference), "
    "a request and its end take no task, queue or timer (ff4f45a: a third fewer instructions in agentd), an action "
    "that ends at once wakes no clock of its bridge (ed5d9fa: a sixth fewer in bridged)"
)


def _loss(floods: list[Flood]) -> str:
    """Return what ended the rise of the rate."""
    last = floods[-1]
    if last.kept_up:
        return f"no rate above {last.made:,.0f} a second was tried, and nothing was lost"
    if not last.in_time:
        return f"of {last.rate:,.0f} changes a second the sender here made {last.reached:,.0f}; {_TRIED}"
    lost = ", ".join(f"{name} {value:,.0f}" for name, value in last.lost.items())
    missing = last.changes - last.heard
    if not lost and missing:
        lost = f"{missing:,} events did not come"
    if not lost and last.disorder:
        lost = f"out of order: {last.disorder[0]}"
    late = "the last event never came" if last.behind < 0 else f"the last event came {last.behind:.2f} s late"
    return f"at {last.reached:,.0f} a second: {lost or late}; why just there is not known; {_TRIED}"


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the block of the page."""
    return {"loop": "\n".join([origin.line(), "", *_latencies(figures), "", *_rates(figures)])}


def _latencies(figures: Figures) -> Iterator[str]:
    size = figures.bytes
    yield (
        f"{len(figures.kept.put)} turns each; µs; percepts of {size['percept']} bytes, actions of {size['action']}, "
        f"statuses of {size['status']}. *Bare* are exchanges of the same sizes between two Python processes with a "
        "session each, through the same router, in turn with the loop: one waits for what comes, the other answers in "
        "its callback, as the daemons hear."
    )
    yield ""
    yield from table("| | bare exchanges in it | p50 | p99 | max | times the bare ones: p50 | p99 |")
    yield row("bare: a put, and put back", "", *_times(figures.kept.put), "", "")
    yield row("bare: a query and its reply", "", *_times(figures.kept.ask), "", "")
    for what, turns, ways in (
        ("percept → action at the robot", figures.kept, "pong"),
        *([("percept → action → status on the bus", figures.kept, "status")] if figures.kept.status else []),
        ("percept → action → status → next action at the robot", figures.kept, "seen"),
        ("the same, agent with `on_restart: fresh`", figures.fresh, "seen"),
    ):
        puts, asks = CONTAINS[ways]
        ratios = (f"{times(turns, part, ways=ways):.1f}" for part in (0.5, 0.99))
        yield row(what, f"{puts:g} puts, {asks:g} queries", *_times(getattr(turns, ways)), *ratios)
    yield ""
    yield _NOTES


def _times(values: list[float]) -> list[str]:
    return [f"{percentile(values, part):,.0f}" for part in PERCENTILES]


def _rates(figures: Figures) -> Iterator[str]:
    yield from table(
        "| percepts for one agent | a second | changes | events | behind, s | bridge, % of a core | agent | router "
        "| lost |"
    )
    for what, floods in (("replaced", figures.replaced), ("added, each for 0.2 s", figures.added)):
        for one in floods:
            behind = "never done" if one.behind < 0 else f"{one.behind:.2f}"
            lost = ", ".join(f"{name} {value:,.0f}" for name, value in one.lost.items()) or "nothing"
            cpu = (f"{one.cpu[who]:.0f}" for who in ("bridged", "agentd", "commd"))
            yield row(what, f"{one.reached:,.0f}", f"{one.changes:,}", f"{one.heard:,}", behind, *cpu, lost)
    yield ""
    yield (
        "The program itself judges the order: each event must be the one after the last. A rate is raised until "
        "changes are lost, the last event comes more than a second late, or the sender, which is a Python program on "
        "the same cores, makes less than it should. Per cents are of the time up to the last event."
    )


def in_short(figures: Figures) -> list[str]:
    """Return the row of README."""
    loop = median(figures.kept.seen) / 1000
    return [
        "| from a percept, through all daemons, to the action that follows the first action's success, p50 "
        f"| {loop:.2f} ms, {times(figures.kept):.1f} times the bare Zenoh exchanges in it | |"
    ]
