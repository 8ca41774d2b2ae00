"""Run the benchmark programs on python-agentspeak (PyPI ``agentspeak``), through its public API only.

The programs run unchanged. Internal actions that python-agentspeak lacks are registered here: ``.nano_time`` and
``.stopMAS``; for the percept row also ``next``, the external action, which is answered immediately.

    python -m benchmarks.reasoner.agentspeak_driver [--percepts ROUNDS,CYCLES] NAME=FILE.asl ...
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import agentspeak
import agentspeak.runtime
import agentspeak.stdlib

ACTIONS = agentspeak.Actions(agentspeak.stdlib.actions)
SOURCE = frozenset([agentspeak.Literal("source", (agentspeak.Literal("percept"),))])


def _nano_time(agent: Any, term: Any, intention: Any) -> Iterator[None]:
    if agentspeak.unify(term.args[0], time.perf_counter_ns(), intention.scope, intention.stack):
        yield


def _stop(agent: Any, term: Any, intention: Any) -> Iterator[None]:
    sys.stdout.flush()
    raise SystemExit(0)
    yield


def _next(agent: Any, term: Any, intention: Any) -> Iterator[None]:
    yield


ACTIONS.add(".nano_time", 1, _nano_time)
ACTIONS.add(".stopMAS", 0, _stop)
ACTIONS.add("next", 0, _next)


def _percept(number: int) -> Any:
    return agentspeak.Literal("counter", (number,), SOURCE)


def feed_percepts(environment: Any, agent: Any, rounds: int, cycles: int) -> None:
    """Replace the percept ``counter(N)`` once per cycle and let the agent react."""
    addition, removal, belief = agentspeak.Trigger.addition, agentspeak.Trigger.removal, agentspeak.GoalType.belief
    number = 0
    for round_number in range(1, rounds + 1):
        begun = time.perf_counter_ns()
        for _ in range(cycles):
            agent.call(removal, belief, _percept(number), agentspeak.runtime.Intention())
            number += 1
            agent.call(addition, belief, _percept(number), agentspeak.runtime.Intention())
            environment.run_agent(agent)
        spent = time.perf_counter_ns() - begun
        print(f"BENCH h_percept round {round_number} ops {cycles} ns {spent}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(prog="agentspeak_driver")
    parser.add_argument("agents", nargs="+", metavar="NAME=FILE.asl")
    parser.add_argument(
        "--percepts", metavar="ROUNDS,CYCLES", help="feed the percept counter(N) instead of just running"
    )
    args = parser.parse_args()
    environment = agentspeak.runtime.Environment()
    agents = []
    for name, _, path in (agent.partition("=") for agent in args.agents):
        with Path(path).open(encoding="utf-8") as source:
            agents.append(environment.build_agent(source, ACTIONS, name=name))
    if args.percepts:
        rounds, cycles = map(int, args.percepts.split(","))
        environment.run()
        feed_percepts(environment, agents[0], rounds, cycles)
    else:
        environment.run()


if __name__ == "__main__":
    main()
