"""The blocks that are made of several parts' results: what README tells in short, and boards beside the paper's."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

import msgspec

from benchmarks import peers, results
from benchmarks.parts import PARTS, Part


def blocks(table: Sequence[Part] = PARTS) -> dict[str, str]:
    """Return them, of those parts that have results."""
    return {"in-short": in_short(table), "comparison-board": comparison_board(table)}


def in_short(table: Sequence[Part] = PARTS) -> str:
    """Return the table of README: the rows `| what | Argosy | others |` of every part that has some (`in_short`)."""
    rows = [
        row
        for one in table
        if (figures := figures_of(one)) is not None and hasattr(one.module(), "in_short")
        for row in one.module().in_short(figures)
    ]
    return "\n".join(["| measured | Argosy | others |", "|---|---|---|", *rows])


def comparison_board(table: Sequence[Part] = PARTS) -> str:
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
    for one in table:
        figures = figures_of(one)
        if figures is not None and hasattr(one.module(), "in_comparison"):
            rows += one.module().in_comparison(figures)
    return "\n".join(["| what | figure | machine | source |", "|---|---|---|---|", *rows])


def figures_of(one: Part) -> Any:
    """Return what a part found; None when it has no results of the shape that it has now."""
    with contextlib.suppress(FileNotFoundError, msgspec.DecodeError, ImportError):
        return results.load(one.name, one.module().Figures)[1]
    return None
