"""A scene as CSV files: tracks, altitudes, modes, actions, messages and places."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from io import StringIO
from itertools import pairwise
from pathlib import Path

from argosy.plot.data import Scene
from commd.process.state_dir import write_output
from schemas.geo import offset

Row = Sequence[object]


def write_tables(scene: Scene, folder: Path) -> list[str]:
    """Write the tables that have rows into a folder, each as a whole. Returns their names. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, (head, rows) in _tables(scene).items():
        if rows:
            table = StringIO()
            csv.writer(table).writerows([head, *rows])
            write_output(folder / f"{name}.csv", table.getvalue().encode())
            written.append(f"{name}.csv")
    return written


def _tables(scene: Scene) -> dict[str, tuple[Row, list[Row]]]:
    origin, begin, end = scene.origin or (0.0, 0.0), scene.begin, scene.end

    def place(position: tuple[float, float]) -> tuple[str, ...]:
        return (*(f"{value:.7f}" for value in position), *(f"{value:.2f}" for value in offset(origin, position)))

    tracks: list[Row] = []
    altitudes: list[Row] = []
    modes: list[Row] = []
    for name, track in scene.tracks.items():
        for point in track.points:
            if begin <= point.at <= end:
                armed = str(track.armed(point.at)).lower()
                tracks.append((name, _seconds(point.at), *place((point.latitude, point.longitude)), armed))
        altitudes += [(name, _seconds(at), f"{metres:.2f}") for at, metres in track.heights if begin <= at <= end]
        for (since, mode), (until, _) in pairwise([*track.modes, (end, "")]):
            if until > begin and since < end:
                modes.append((name, _seconds(since), _seconds(until), mode))
    messages: list[Row] = [
        (
            one.sender,
            one.receiver,
            _seconds(one.sent),
            _seconds(one.received),
            one.performative,
            one.content,
            one.undelivered,
        )
        for one in scene.messages
    ]
    return {
        "tracks": (("robot", "s", "latitude", "longitude", "m_east", "m_north", "armed"), tracks),
        "altitudes": (("robot", "s", "m_above_home"), altitudes),
        "modes": (("robot", "begin_s", "end_s", "mode"), modes),
        "actions": (
            ("agent", "begin_s", "end_s", "action", "state", "reason"),
            [
                (one.agent, _seconds(one.began), _seconds(one.ended), one.text, one.state, one.reason)
                for one in scene.actions
            ],
        ),
        "messages": (
            ("sender", "receiver", "sent_s", "received_s", "performative", "content", "undelivered"),
            messages,
        ),
        "places": (
            ("kind", "label", "robot", "s", "latitude", "longitude", "m_east", "m_north"),
            [(one.kind, one.label, one.robot, _seconds(one.at), *place(one.position)) for one in scene.places],
        ),
    }


def _seconds(at: float | None) -> str:
    return "" if at is None else f"{at:.3f}"
