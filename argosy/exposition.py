"""A fleet's health in the text format of Prometheus (version 0.0.4).

Three rules make the format: a HELP and a TYPE line before the samples of a metric, and backslash, quote and line break
escaped in values of labels. The library `prometheus_client` would bring a registry of its own, counters that it wants
to count itself and a server with a thread for each caller; it judges this text in the tests instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from argosy.roll import Row
from schemas.records import Health

COUNTERS = 100
"""Counters of one daemon that are told; further ones are left out."""


@dataclass(frozen=True)
class Metric:
    """One figure of each daemon that tells how it is."""

    name: str
    kind: Literal["gauge", "counter"]
    help: str
    value: Callable[[Health], float | None]


METRICS = (
    Metric("argosy_uptime_seconds", "gauge", "Seconds since the daemon started.", lambda one: one.uptime),
    Metric("argosy_cpu_seconds_total", "counter", "Processor time of its process.", lambda one: one.cpu),
    Metric("argosy_lag_seconds", "gauge", "Seconds by which it is behind.", lambda one: one.lag),
    Metric("argosy_drops_total", "counter", "What its queues have dropped.", lambda one: one.drops),
    Metric("argosy_bad_input_total", "counter", "Input that did not decode.", lambda one: one.bad_input),
    Metric("argosy_errors_total", "counter", "Errors that it has logged.", lambda one: one.errors),
    Metric("argosy_restarts", "gauge", "Starts after an end that nobody ordered.", lambda one: one.restarts),
    Metric("argosy_notes", "gauge", "Warnings in words that hold now.", lambda one: len(one.notes)),
)


def exposition(fleet: str, rows: Sequence[Row], *, router_up: bool, dropped: int = 0) -> str:
    """Return the whole page; `dropped` is what came of more daemons than are followed."""
    return "\n".join(_lines(fleet, rows, router_up, dropped)) + "\n"


def _lines(fleet: str, rows: Sequence[Row], router_up: bool, dropped: int) -> Iterator[str]:
    yield from _head("argosy_router_up", "gauge", "Whether the router answers this exporter.")
    yield f"argosy_router_up{_labels(fleet=fleet)} {int(router_up)}"
    yield from _head("argosy_not_followed_total", "counter", "What came of more daemons than are followed.")
    yield f"argosy_not_followed_total{_labels(fleet=fleet)} {dropped}"
    yield from _head("argosy_up", "gauge", "Whether a daemon is there and tells how it is.")
    for row in rows:
        yield f"argosy_up{_of(fleet, row)} {int(row.standing == 'up')}"
    told = [(row, row.now) for row in rows if row.now is not None]
    yield from _head("argosy_record_age_seconds", "gauge", "Seconds since a daemon told how it is.")
    for row, _ in told:
        yield f"argosy_record_age_seconds{_of(fleet, row)} {row.age or 0.0:.3f}"
    yield from _head("argosy_info", "gauge", "Which version a daemon is of.")
    for row, health in told:
        yield f"argosy_info{_of(fleet, row, version=health.version)} 1"
    for metric in METRICS:
        yield from _head(metric.name, metric.kind, metric.help)
        for row, health in told:
            if (value := metric.value(health)) is not None:
                yield f"{metric.name}{_of(fleet, row)} {float(value)!r}"
    yield from _head("argosy_counter", "gauge", "A figure of a daemon's own: see docs/health.md.")
    for row, health in told:
        for name in sorted(health.counters)[:COUNTERS]:
            yield f"argosy_counter{_of(fleet, row, counter=name)} {float(health.counters[name])!r}"


def _head(name: str, kind: str, text: str) -> list[str]:
    return [f"# HELP {name} {text}", f"# TYPE {name} {kind}"]


def _of(fleet: str, row: Row, **more: str) -> str:
    return _labels(fleet=row.fleet or fleet, board=row.board, daemon=row.daemon, name=row.name, **more)


def _labels(**labels: str) -> str:
    return "{" + ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items()) + "}"


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("\n", "\\n").replace('"', '\\"')
