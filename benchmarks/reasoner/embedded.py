"""Run the percept row on agentd as a library, which feeds percepts and answers ``next`` itself.

This is how python-agentspeak is driven too (`benchmarks.reasoner.agentspeak_driver`).

    python -m benchmarks.reasoner.embedded ROUNDS CYCLES DECISIONS FILE.asl
"""

from __future__ import annotations

import sys
import time

from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_file
from agentd.mind import Mind
from agentd.mind.data.effects import PerformAction
from agentd.mind.data.inputs import ActionDone, PerceptReplaced
from agentd.values import literal

_MANY = 100
"""A mind stops by itself when there is an effect, or nothing left to do."""


def main() -> None:
    rounds, cycles, decisions = map(int, sys.argv[1:4])
    mind = Mind("ag", compile_program(parse_file(sys.argv[4])), decisions=decisions)
    number = 0
    for round_number in range(1, rounds + 1):
        begun, done = time.perf_counter_ns(), 0
        while done < cycles:
            number += 1
            mind.feed(PerceptReplaced(literal("counter", number)))
            for effect in mind.run(0.0, _MANY):
                assert isinstance(effect, PerformAction)
                mind.feed(ActionDone(effect.id, True))
                done += 1
        spent = time.perf_counter_ns() - begun
        print(f"BENCH h_percept round {round_number} ops {cycles} ns {spent}", flush=True)


if __name__ == "__main__":
    main()
