"""The decision loop through the real daemons: its latency, where the time goes, and how many percepts it takes."""

from benchmarks.loop.part import Figures, blocks, goals, in_short, measure, pictures

__all__ = ["Figures", "blocks", "goals", "in_short", "measure", "pictures"]
