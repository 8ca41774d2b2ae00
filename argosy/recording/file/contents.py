"""What a recording holds, in words and as JSON: `argosy replay FILE --info`."""

from __future__ import annotations

import json
from collections import Counter
from datetime import UTC, datetime
from itertools import chain, islice
from typing import Any

from argosy.recording.file.metadata import SECOND
from argosy.recording.file.mind_inputs import PART, Life, in_words
from argosy.recording.file.reader import Recording
from argosy.recording.record.minds import MOST_MISSING
from schemas.humanize import count, printable, size

Unread = Counter[tuple[str, str]]
"""Stretches of inputs that do not decode, by fleet and agent."""


def contents(recording: Recording, *, as_json: bool = False) -> str:
    """Return what a recording holds."""
    unread: Unread = Counter()
    lives = recording.lives(unread=unread)
    if as_json:
        return json.dumps(_data(recording, lives, unread), indent=2, ensure_ascii=False) + "\n"
    return (
        "\n".join(map(printable, [*_head(recording), "", *_minds(recording, lives, unread), "", *_topics(recording)]))
        + "\n"
    )


def _head(recording: Recording) -> list[str]:
    facts, end = recording.facts, recording.end
    began = datetime.fromtimestamp(facts.started / SECOND, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    held = sum(file.stat().st_size for file in recording.files)
    files = f"{len(recording.files)} files, " if len(recording.files) > 1 else ""
    mission = f", mission {facts.mission} ({facts.mission_file}, at speed {facts.speed:g})" if facts.mission else ""
    lines = [
        f"{recording.path}: {files}{size(held)}, of Argosy {facts.version}",
        f"  fleet    {', '.join(recording.fleets) or facts.fleet}{mission}",
        f"  began    {began}",
        f"  lasts    {recording.seconds:.1f} s, {sum(topic.messages for topic in recording.topics)} messages",
        f"  ended    {end.why if end is not None else 'it did not: it was cut off, or goes on'}",
    ]
    if recording.missing:
        lines.append(f"  missing  {recording.missing}")
    if facts.only:
        lines.append(f"  only     {' '.join(facts.only)}")
    if end is not None and (lost := end.dropped + end.too_large):
        lines.append(f"  dropped  {lost} messages that did not fit")
    lines += [f"  {name:8} {text}" for name, text in facts.notes.items()]
    return lines


def _minds(recording: Recording, lives: list[Life], unread: Unread) -> list[str]:
    width = max((len(agent) for agent in [*(life.agent for life in lives), *(agent for _, agent in unread)]), default=0)
    told = [f"  {life.agent:{width}}  {life.boot:8}  {_life(life)}" for life in lives]
    for (_, agent), number in sorted(unread.items()):
        batches = count(number, "batch", "batches")
        told.append(f"  {agent:{width}}  {batches} of its inputs cannot be read: another version of Argosy wrote them")
    if told:
        return ["minds", *told]
    if any(topic.key.endswith(f"/{PART}") for topic in recording.topics):
        return ["no minds: what stands under `trace/inputs` is none of Argosy's"]
    return ["no minds: `trace/inputs` was not recorded"]


def _life(life: Life) -> str:
    last = life.batches[-1]
    if life.whole:
        birth = life.batches[0].birth
        unknown = f", and cannot be lived again: {birth.unknown}" if birth is not None and birth.unknown else ""
        decided = sum(batch.decided for batch in life.batches)
        told = "whole" if life.ended else f"from birth to {life.until:.1f} s of mission time, its end is missing"
        return f"{told}, {last.last} cycles, {decided} decisions and effects{unknown}"
    if life.missing:
        return f"incomplete: of its inputs {in_words(life.missing)} of {last.number + 1} are missing"
    return "incomplete: its birth is missing"


def _topics(recording: Recording) -> list[str]:
    if not recording.topics:
        return ["nothing was said"]
    seconds = max(recording.seconds, 1e-9)
    width = max(len(topic.key) for topic in recording.topics)
    names = max(len(topic.record) for topic in recording.topics)
    rows = [
        f"  {topic.key:{width}}  {topic.record:{names}}  {topic.messages:>7}  {topic.messages / seconds:>8.2f}"
        for topic in recording.topics
    ]
    return [f"  {'':{width}}  {'':{names}}  {'number':>7}  {'Hz':>8}", *rows]


def _data(recording: Recording, lives: list[Life], unread: Unread) -> dict[str, Any]:
    facts, end = recording.facts, recording.end
    return {
        "files": [str(file) for file in recording.files],
        "fleets": recording.fleets,
        "mission": facts.mission,
        "speed": facts.speed,
        "version": facts.version,
        "started": facts.started,
        "seconds": recording.seconds,
        "ended": None if end is None else end.why,
        "missing": recording.missing,
        "dropped": 0 if end is None else end.dropped + end.too_large,
        "notes": dict(facts.notes),
        "minds": [
            {
                "agent": life.agent,
                "boot": life.boot,
                "whole": life.whole and life.ended,
                "end": life.ended,
                "batches": len(life.batches),
                "missing": list(islice(chain.from_iterable(life.missing), MOST_MISSING)),
            }
            for life in lives
        ],
        "unread_inputs": [
            {"fleet": fleet, "agent": agent, "batches": count} for (fleet, agent), count in sorted(unread.items())
        ],
        "topics": [
            {"key": topic.key, "record": topic.record, "messages": topic.messages} for topic in recording.topics
        ],
    }
