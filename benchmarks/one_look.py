"""What one look at a mind that never rests takes of the thread that reasons, with nothing else around it."""

from __future__ import annotations

import statistics
import time
from types import SimpleNamespace
from typing import Any

from agentd.language.compile import compile_program
from agentd.language.parser import parse_program
from agentd.look import Look
from agentd.mind import Mind
from agentd.mind.keeping import Keeper
from agentd.viewer import Viewer
from commd.clock import Clock
from schemas.codec import codec
from schemas.minds import MindView
from schemas.records import Header

LOOKS = 60
BETWEEN = 0.25
"""Seconds of processor time that the mind reasons between two looks: all that it shows has changed."""


def one_look(program: str, look: Look) -> float:
    """Milliseconds of processor time from the question to the bytes of the answer: the median of `LOOKS`."""
    mind = Mind("busy", compile_program(parse_program(program, "busy.asl")), decisions=200, keeper=Keeper(None))
    bus: Any = SimpleNamespace(fleet="x", serve=lambda *_: None, header=lambda *_: Header())
    control: Any = SimpleNamespace(left=None, paused=False)
    viewer = Viewer(bus, mind, Clock(1.0), control, life="", prints=(), actions=(), done={}, failed={})
    taken = []
    for _ in range(LOOKS):
        until = time.thread_time() + BETWEEN
        while time.thread_time() < until:
            mind.run(0.0, 500)
            mind.beliefs.mark(0.0)
        begun = time.thread_time()
        codec(MindView).encode(viewer.view(look), "json")
        taken.append(1000 * (time.thread_time() - begun))
    return statistics.median(taken)
