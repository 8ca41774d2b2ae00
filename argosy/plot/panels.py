"""The panels of a plot that share the axis of mission time: altitude, modes, actions, messages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from argosy.fleet_model.actions import ActionSeen
from argosy.fleet_model.message_log import LoggedMessage
from argosy.plot.data import Scene
from argosy.plot.style import (
    FAINT,
    INK,
    LINES,
    MODES,
    OPEN,
    OUTCOMES,
    PERFORMATIVES,
    ROBOTS,
    performative_kind,
)

MOST_ROWS = 48
"""Rows of actions by name; of more kinds there is one row for each agent."""
LOST: dict[str, Any] = {"color": INK, "marker": "x", "markersize": 3.2, "markeredgewidth": 0.9, "linestyle": "none"}
"""Mark of a message without a recorded receipt."""
LETTER = 0.62
"""Width of a letter by its height, about."""


def colour_of(scene: Scene, robot: str) -> tuple[str, Any]:
    """Return colour and line of a robot: of the whole recording, so that a part of it looks alike."""
    index = list(dict.fromkeys([*scene.robot_of.values(), *scene.robots])).index(robot)
    return ROBOTS[index % len(ROBOTS)], LINES[index // len(ROBOTS) % len(LINES)]


def robot_handles(scene: Scene) -> list[Any]:
    """Return the entries of the legend for the robots."""
    found = []
    for name in scene.robots:
        colour, line = colour_of(scene, name)
        found.append(Line2D([], [], color=colour, linestyle=line, linewidth=1.2, label=name))
    return found


def altitude(axes: Any, scene: Scene) -> list[Any]:
    """Draw metres above home over mission time."""
    highest = 1.0
    for name, track in scene.tracks.items():
        colour, line = colour_of(scene, name)
        shown = _during(track.heights, scene)
        highest = max([highest, *(height for _, height in shown)])
        axes.plot([at for at, _ in shown], [height for _, height in shown], color=colour, linestyle=line, linewidth=0.9)
    axes.set_ylim(min([0.0, *(h for track in scene.tracks.values() for _, h in track.heights)]) - 0.5, highest * 1.1)
    axes.set_ylabel("m above home")
    return []


def _during(line: Sequence[tuple[float, float]], scene: Scene) -> list[tuple[float, float]]:
    """Return the visible stretch of a line, extended to its ends: an unchanged value is not published again."""
    before = [value for at, value in line if at < scene.begin][-1:]
    inside = [(at, value) for at, value in line if scene.begin <= at <= scene.end]
    last = inside[-1][1] if inside else before[-1] if before else None
    head = [(scene.begin, value) for value in before]
    return [*head, *inside, *([(scene.end, last)] if last is not None else [])]


def mode_rows(scene: Scene) -> list[str]:
    """Return the robots whose modes are known."""
    return [name for name, track in scene.tracks.items() if track.modes]


def modes(axes: Any, scene: Scene, inches: float) -> list[Any]:
    """Draw a band of modes for each robot; `inches` is the panel's width."""
    rows = mode_rows(scene)
    shades = {name: MODES[index % len(MODES)] for index, name in enumerate(scene.modes)}
    used: dict[str, None] = {}
    size = float(axes.xaxis.label.get_size()) - 1
    for index, row in enumerate(rows):
        for (begin, mode), (end, _) in pairwise([*scene.tracks[row].modes, (scene.end, "")]):
            begin, end = max(begin, scene.begin), min(end, scene.end)
            if end <= begin:
                continue
            used[mode] = None
            axes.barh(index, end - begin, left=begin, height=0.86, color=shades[mode], edgecolor=FAINT, linewidth=0.3)
            room = (end - begin) / (scene.end - scene.begin) * inches * 72
            if room > LETTER * size * (len(mode) + 1):
                axes.text((begin + end) / 2, index, mode, ha="center", va="center", fontsize=size, clip_on=True)
    _rows(axes, rows)
    return [Patch(facecolor=shades[mode], edgecolor=FAINT, linewidth=0.3, label=mode or "unknown") for mode in used]


def action_rows(scene: Scene) -> list[tuple[str, str]]:
    """Return agent and action of each row; an agent alone heads its actions, or has the only row for all of them."""
    kinds: dict[str, dict[str, None]] = {}
    for agent in scene.agents:
        for one in scene.actions:
            if one.agent == agent:
                kinds.setdefault(agent, {})[one.name] = None
    if sum(map(len, kinds.values())) > MOST_ROWS:
        return [(agent, "") for agent in kinds]
    heads = [("",)] if len(kinds) > 1 else [()]
    return [(agent, name) for agent, names in kinds.items() for name in (*heads[0], *names)]


def actions(axes: Any, scene: Scene) -> list[Any]:
    """Draw a bar for each action, from its first status to its outcome; what failed is marked where it ended."""
    rows = action_rows(scene)
    bars: dict[tuple[str, bool], list[tuple[float, float, int]]] = {}
    for one in scene.actions:
        row = rows.index((one.agent, one.name) if (one.agent, one.name) in rows else (one.agent, ""))
        state: str = one.state if one.state in OUTCOMES and one.ended is not None else ""
        bars.setdefault((state, bool(state)), []).append((*_stretch(one, scene), row))
    for (state, ended), drawn in bars.items():
        _bars(axes, state, ended, drawn)
    _rows(axes, [name or agent for agent, name in rows])
    if any(name for _, name in rows):
        for index, (label, (_, name)) in enumerate(zip(axes.get_yticklabels(), rows, strict=True)):
            if not name:
                label.set_fontweight("bold")
                axes.axhline(index - 0.5, color=FAINT, linewidth=0.5)
    return [_outcome_handle(state) for state in [*OUTCOMES, ""] if (state, bool(state)) in bars]


def _stretch(one: ActionSeen, scene: Scene) -> tuple[float, float]:
    """Return when the bar of an action begins and ends: long enough to be seen."""
    begin, end = max(one.began, scene.begin), min(one.ended if one.ended is not None else scene.end, scene.end)
    return begin, max(end, begin + (scene.end - scene.begin) / 250)


def _bars(axes: Any, state: str, ended: bool, drawn: list[tuple[float, float, int]]) -> None:
    colour, mark, _ = OUTCOMES.get(state, OPEN)  # type: ignore[call-overload]
    half = 0.31
    corners = [
        [(begin, row - half), (end, row - half), (end, row + half), (begin, row + half)] for begin, end, row in drawn
    ]
    look: dict[str, Any] = {
        "facecolors": colour,
        "edgecolors": INK,
        "linewidths": 0.3,
        "hatch": "" if ended else "////",
    }
    axes.add_collection(PolyCollection(corners, **look), autolim=False)
    if mark:
        style: dict[str, Any] = {
            "color": INK,
            "marker": mark,
            "markersize": 3.2,
            "markeredgewidth": 0.9,
            "linestyle": "none",
        }
        axes.plot([end for _, end, _ in drawn], [row for _, _, row in drawn], **style)


def _outcome_handle(state: str) -> Any:
    colour, mark, text = OUTCOMES.get(state, OPEN)  # type: ignore[call-overload]
    if mark:
        style: dict[str, Any] = {
            "markeredgecolor": INK,
            "markersize": 3.2,
            "markeredgewidth": 0.9,
            "solid_capstyle": "butt",
        }
        return Line2D([], [], color=colour, linewidth=4, marker=mark, label=text, **style)
    return Patch(facecolor=colour, edgecolor=INK, linewidth=0.3, hatch="" if state else "////", label=text)


def message_rows(scene: Scene) -> list[str]:
    """Return the agents that send or receive."""
    met = {name for one in scene.messages for name in (one.sender, one.receiver)}
    return [name for name in scene.agents if name in met]


def messages(axes: Any, scene: Scene) -> list[Any]:
    """Draw an arrow for each message, from the line of its sender to that of its receiver."""
    rows = {name: index for index, name in enumerate(message_rows(scene))}
    kinds: dict[str, list[LoggedMessage]] = {}
    for one in scene.messages:
        kinds.setdefault(performative_kind(one.performative, bool(one.in_reply_to)), []).append(one)
    for index in rows.values():
        axes.axhline(index, color=FAINT, linewidth=0.4, zorder=1)
    for kind, several in kinds.items():
        _arrows(axes, several, rows, PERFORMATIVES[kind])
    _rows(axes, rows, lines=False)
    handles = [
        Line2D([], [], color=PERFORMATIVES[kind], linewidth=0.9, label=kind) for kind in PERFORMATIVES if kind in kinds
    ]
    if lost := [one for one in scene.messages if one.received is None]:
        middles = [(rows[one.sender] + rows[one.receiver]) / 2 for one in lost]
        axes.plot([one.at for one in lost], middles, zorder=4, **LOST)
        handles.append(Line2D([], [], label="not received", **LOST))
    return handles


def _arrows(axes: Any, several: list[LoggedMessage], rows: dict[str, int], colour: str) -> None:
    """Draw the messages of one kind as one line with gaps, and their heads as two rows of marks."""
    x, y = [], []
    heads: dict[str, list[tuple[float, float]]] = {"v": [], "^": []}
    for one in several:
        sender, receiver = rows[one.sender], rows[one.receiver]
        begin = one.sent if one.sent is not None else one.at
        if one.received is None:  # it ends half way
            x += [begin, begin, math.nan]
            y += [sender, (sender + receiver) / 2, math.nan]
            continue
        x += [begin, one.received, math.nan]
        y += [sender, receiver, math.nan]
        down = receiver >= sender  # rows count downwards
        heads["v" if down else "^"].append((one.received, receiver - 0.08 if down else receiver + 0.08))
    axes.plot(x, y, color=colour, linewidth=0.6, zorder=2)
    for marker, tips in heads.items():
        if tips:
            style: dict[str, Any] = {
                "color": colour,
                "marker": marker,
                "markersize": 2.6,
                "markeredgewidth": 0,
                "linestyle": "none",
            }
            axes.plot([at for at, _ in tips], [row for _, row in tips], zorder=3, **style)


def _rows(axes: Any, labels: Iterable[str], lines: bool = True) -> None:
    """Name the rows of a panel, the first one at the top."""
    names = list(labels)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", length=0)
    if not lines:
        axes.grid(False, axis="y")
