"""The blocks that are made of several parts' results: all goals, README's table, boards beside the paper's."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

import msgspec

from benchmarks import pages, peers, results
from benchmarks.pages import table
from benchmarks.parts import PARTS, Part, goal_rows

BUSY = 0.5
"""Cores that others may keep busy before figures are marked as those of a busy machine."""
Found = tuple[results.Origin, Any]
"""Where the figures of a part come from, and the figures."""


def blocks(parts: Sequence[Part] = PARTS) -> dict[str, str]:
    """Return them, of those parts that have results."""
    found = {one: loaded for one in parts if (loaded := load(one)) is not None}
    goals = [row for one in parts for row in _goals(one, found.get(one))]
    short = [row for one, (_, figures) in found.items() for row in one.rows("in_short", figures)]
    return {
        "goals": "\n".join(table("| part | figure | goal | measured | |", goals)),
        "in-short": "\n".join(table("| measured | Argosy | others |", short)),
        "comparison-board": comparison_board(found),
    }


def load(one: Part) -> Found | None:
    """Return what a part found; None when it has no results of the shape that it has now."""
    with contextlib.suppress(FileNotFoundError, msgspec.DecodeError, ImportError):
        return results.load(one.name, one.module().Figures)
    return None


def _goals(one: Part, found: Found | None) -> list[str]:
    """Return the rows of a part, with a link to its first block."""
    if found is None:
        return [f"| {one.name} | | | | **not measured** |"]
    origin, figures = found
    name = one.name
    with contextlib.suppress(KeyError):
        name = f"[{name}]({pages.section(next(iter(one.module().blocks(origin, figures))))})"
    return goal_rows(one.goals(figures), part=name, busy=max(origin.load, origin.others) > BUSY)


def comparison_board(found: dict[Part, Found]) -> str:
    """Return the table of docs/measurements/comparison.md about the memory of a board, beside what the paper's
    authors published."""
    low, high, python_low, python_high, agent_low, agent_high = (
        f"{peers.mb(value):.0f}"
        for value in (*peers.JASON_BOARD, *peers.PYTHON_BOARD, *peers.PROCESSES["Jason agent"].memory)
    )
    jason, python = peers.TABLE_3["Jason"], peers.TABLE_3["Python"]
    rows = [
        f"| the paper's nodes in all: agent, HwBridge, Comm, mavros, roscore | {low} to {high} MB, of it the "
        f"agent {agent_low} to {agent_high} | Raspberry Pi 3 | measurements published with the paper |",
        f"| the same with a Python program in the agent's place | {python_low} to "
        f"{python_high} MB | Raspberry Pi 3 | the same |",
        f"| the paper's board with its agent; with a Python program | {jason.memory.mean:.2f} % of the memory, "
        f"{jason.cpu.mean:.2f} % CPU; {python.memory.mean:.2f} %, {python.cpu.mean:.2f} % | Raspberry Pi 3 "
        "| the paper, table 3 |",
    ]
    rows += [row for one, (_, figures) in found.items() for row in one.rows("in_comparison", figures)]
    return "\n".join(table("| what | figure | machine | source |", rows))
