"""The environment of the percept row: one percept ``counter(N)`` replaced per cycle, ``next`` answered immediately.

agentd run --env benchmarks.reasoner.counter:Counter --env-arg 10 --env-arg 20000 \\
        ag=benchmarks/reasoner/programs/h_percept.asl
"""

from __future__ import annotations

import os
import sys
import time

from agentd.environment import Environment, Literal, literal


class Counter(Environment):
    """Moves the counter at each ``next``, prints how long each round took, and ends the process after the last.

    The arguments are the number of rounds and of cycles in each.
    """

    def init(self, arguments: list[str]) -> None:
        self._rounds, self._cycles = map(int, arguments)
        self._count, self._round, self._begun = 0, 1, time.perf_counter_ns()
        self.replace_percept(literal("counter", self._count))

    def execute(self, agent: str, action: Literal) -> bool:
        self._count += 1
        if self._count % self._cycles == 0:
            self._end_round()
        self.replace_percept(literal("counter", self._count))
        return True

    def _end_round(self) -> None:
        spent = time.perf_counter_ns() - self._begun
        print(f"BENCH h_percept round {self._round} ops {self._cycles} ns {spent}", flush=True)
        if self._round == self._rounds:
            sys.stdout.flush()
            os._exit(0)
        self._round, self._begun = self._round + 1, time.perf_counter_ns()
