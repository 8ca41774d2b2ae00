"""The percept row on agentd: one percept ``counter(N)`` replaced per cycle, the action ``next`` answered at once.

python -m benchmarks.counter ROUNDS,CYCLES FILE.asl
"""

from __future__ import annotations

import sys
import time

from agentd.language.compile import compile_program
from agentd.language.parser import parse_file
from agentd.language.signatures import signature
from agentd.language.terms import Literal
from agentd.mind import Mind
from agentd.mind.effects import PerformAction
from agentd.mind.inputs import ActionDone, PerceptReplaced

_COUNTER = signature("counter", 1)


def main() -> None:
    rounds, cycles = map(int, sys.argv[1].split(","))
    mind = Mind("ag", compile_program(parse_file(sys.argv[2])))
    number = 0.0
    for round_number in range(1, rounds + 1):
        begun = time.perf_counter_ns()
        done = 0
        while done < cycles:
            number += 1.0
            mind.feed(PerceptReplaced(Literal(_COUNTER, (number,))))
            for effect in mind.run(0.0, 100):
                assert isinstance(effect, PerformAction)
                done += 1
                mind.feed(ActionDone(effect.id, True))
        print(f"BENCH h_percept round {round_number} ops {cycles} ns {time.perf_counter_ns() - begun}", flush=True)


if __name__ == "__main__":
    main()
