"""What a run has left behind, read when all is over: printed lines, health records, what the vehicles tell."""

from __future__ import annotations

import re
from collections import Counter
from typing import Final

from benchmarks.scale import health as scale_health
from benchmarks.scale.found import BEAT_LATE, LATE, Run
from benchmarks.scale.talkers import Told
from benchmarks.spread import NOTHING, spread
from benchmarks.watched import Watched

_AT: Final = re.compile(r"\[agent(\d+)\] at (\d+)$")
_ASKED: Final = re.compile(r"\[agent\d+\] asked ([\d.eE+-]+)$")
_STATE: Final = re.compile(r" action=(\w+) .*\bstate=(\w+)")


def latencies(found: Run, agents: list[Watched], told: Told, begun: float, ended: float) -> None:
    """Read how long positions and actions took from what agents have printed, and when positions were sent."""
    came: dict[tuple[int, int], float] = {}
    asked: list[float] = []
    actions: Counter[str] = Counter()
    for at, line in (one for daemon in agents for one in daemon.said):
        if position := _AT.search(line):
            came[int(position[1]), int(position[2])] = at
        elif begun <= at <= ended and (answer := _ASKED.search(line)):
            asked.append(float(answer[1]) / 1000)
        elif begun <= at <= ended and (status := _STATE.search(line)):
            actions[status[2]] += 1
    sent = {
        (system, metres): at
        for system, those in told.sent.items()
        for metres, at in those.items()
        if begun <= at <= ended
    }
    took = [1000 * (came[one] - sent[one]) for one in sent.keys() & came.keys()]
    found.percept = spread(took) if took else NOTHING
    found.unseen = len(sent) - len(took)
    found.in_time = sum(one <= LATE for one in took) / len(sent) if sent else 0.0
    found.asked = spread(asked) if asked else NOTHING
    found.actions = dict(actions)
    found.talkers_late = 1000 * max(
        (late for at, late in zip(told.late[::2], told.late[1::2], strict=True) if begun <= at <= ended), default=0.0
    )


def missed(found: Run, records: scale_health.Records, told: Told, begun: float, ended: float, datagrams: int) -> None:
    """Count what was late or lost between two moments, and what bridges took in and told."""
    grown = scale_health.grown(records, begun, ended)
    bridges, agents, boards = (grown[kind] for kind in ("bridged", "agentd", "commd"))
    wanted = {"commd": 1, "bridged": len(told.beats), "agentd": len(told.beats)}
    if found.vehicles == "copters":
        wanted |= dict.fromkeys(("bridged", "agentd"), found.size + 1)
    found.messages, found.percepts = bridges.rates["messages"], bridges.rates["percepts"]
    found.lag = {kind: 1000 * scale_health.worst_lag(records, kind, begun, ended) for kind in wanted}
    found.missed = {
        "actions timed out": found.actions.get("timed_out", 0),
        "actions failed or refused": sum(found.actions.get(one, 0) for one in ("failed", "refused")),
        "percepts that grew stale": bridges.counts["percepts_expired"],
        "percepts that did not come": agents.counts["percepts_missed"],
        "percepts that came after the status that refers to them": agents.counts["percepts_late"],
        "heartbeats of a bridge late": sum(
            scale_health.gaps(times, begun, ended, BEAT_LATE) for times in told.beats.values()
        ),
        "health records late": scale_health.late(records, begun, ended, wanted),
        "datagrams lost before the bridge": datagrams,
        "dropped by queues": sum(one.counts["drops"] for one in (bridges, agents, boards)),
        "not readable": sum(one.counts["bad_input"] for one in (bridges, agents, boards)),
        "lines logged as errors": scale_health.errors(records, begun, ended),
    }


_ROUNDS: Final = re.compile(r"late: (\d+) of \d+ rounds .*; ([\d.]+) s never happened")


def simulators(found: Run, copters: list[Watched], begun: float, ended: float) -> None:
    """Read what the simulators have said of their pace: what they said last less what they had said before."""
    for one in copters:
        said = [(at, int(m[1]), float(m[2])) for at, line in one.said if (m := _ROUNDS.search(line))]
        before = [told for told in said if told[0] < begun]
        late, never = (said[-1][1:] if said else (0, 0.0)), (before[-1][1:] if before else (0, 0.0))
        found.late_rounds += late[0] - never[0]
        found.never_happened += late[1] - never[1]
