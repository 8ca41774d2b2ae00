"""A scene as CSV files: tracks, altitudes, modes, actions, messages and places."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

from argosy.plot.data import Scene
from schemas.geo import offset

Row = Sequence[object]


def write_tables(scene: Scene, folder: Path) -> list[str]:
    """Write the tables that have rows into a folder, which is made. Returns their names. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, (head, rows) in _tables(scene).items():
        if rows:
            with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
                csv.writer(file).writerows([head, *rows])
            written.append(f"{name}.csv")
    return written


def _tables(scene: Scene) -> dict[str, tuple[Row, list[Row]]]:
    return {
        "tracks": (("robot", "s", "latitude", "longitude", "m_east", "m_north", "armed"), list(_tracks(scene))),
        "altitudes": (("robot", "s", "m_above_home"), list(_altitudes(scene))),
        "modes": (("robot", "begin_s", "end_s", "mode"), list(_modes(scene))),
        "actions": (("agent", "begin_s", "end_s", "action", "state", "reason"), list(_actions(scene))),
        "messages": (
            ("sender", "receiver", "sent_s", "received_s", "performative", "content", "undelivered"),
            list(_messages(scene)),
        ),
        "places": (("kind", "label", "robot", "s", "latitude", "longitude", "m_east", "m_north"), list(_places(scene))),
    }


def _tracks(scene: Scene) -> Iterable[Row]:
    origin = scene.origin or (0.0, 0.0)
    for name, track in scene.tracks.items():
        for point in track.points:
            if scene.begin <= point.at <= scene.end:
                position = point.latitude, point.longitude
                armed = str(track.armed(point.at)).lower()
                yield name, _seconds(point.at), *map(_degrees, position), *map(_metres, offset(origin, position)), armed


def _altitudes(scene: Scene) -> Iterable[Row]:
    for name, track in scene.tracks.items():
        for at, altitude in track.heights:
            if scene.begin <= at <= scene.end:
                yield name, _seconds(at), _metres(altitude)


def _modes(scene: Scene) -> Iterable[Row]:
    for name, track in scene.tracks.items():
        for (begin, mode), (end, _) in pairwise([*track.modes, (scene.end, "")]):
            if end > scene.begin and begin < scene.end:
                yield name, _seconds(begin), _seconds(end), mode


def _actions(scene: Scene) -> Iterable[Row]:
    for one in scene.actions:
        yield one.agent, _seconds(one.began), _seconds(one.ended), one.text, one.state, one.reason


def _messages(scene: Scene) -> Iterable[Row]:
    for one in scene.messages:
        times = _seconds(one.sent), _seconds(one.received)
        yield one.sender, one.receiver, *times, one.performative, one.content, one.undelivered


def _places(scene: Scene) -> Iterable[Row]:
    origin = scene.origin or (0.0, 0.0)
    for one in scene.places:
        where = *map(_degrees, one.position), *map(_metres, offset(origin, one.position))
        yield one.kind, one.label, one.robot, _seconds(one.at), *where


def _seconds(at: float | None) -> str:
    return "" if at is None else f"{at:.3f}"


def _degrees(value: float) -> str:
    return f"{value:.7f}"


def _metres(value: float) -> str:
    return f"{value:.2f}"
