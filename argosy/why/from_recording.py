"""Rebuild a mind as it was at a moment of a recording, by replaying its recorded inputs up to then."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import takewhile
from pathlib import Path

from msgspec.structs import replace

from agentd.conversion.introspection import MOST_BELIEFS, Look
from agentd.conversion.mind_view import MindViews
from agentd.extensions.plugins import discover
from agentd.replay.replayed_mind import CannotReplay, ReplayedMind
from argosy.cli.errors import CommandError
from argosy.recording.mind_inputs import Life, range_text
from argosy.recording.played_minds import MOST_ACTIONS
from argosy.recording.reader import Recording, open_recording
from schemas.files.findings import did_you_mean
from schemas.wire import keys
from schemas.wire.mind_records import ActivityEvent, MindActivity, MindInputs, MindView

LOOK = Look(plans=True, last=1000, beliefs=MOST_BELIEFS)
"""A replayed mind remembers more decisions than one in flight."""


class NotRecorded(CommandError):
    """The agent or time is not in the recording."""


def recorded_view(file: Path, agent: str, at: float | None = None) -> tuple[MindView, list[str]]:
    """Return a mind as it was at a mission second, by default at the end, and what should be known of that.

    Raises BadRecording and NotRecorded.
    """
    recording = open_recording(file)
    life = _life(recording, agent, at)
    batches = [batch for _, batch in takewhile(lambda pair: pair[0] == pair[1].number, enumerate(life.batches))]
    if not batches or batches[0].birth is None:
        raise NotRecorded(f"{file}: it lacks the beginning of {agent}'s life: start to record before the agent starts")
    notes = [recording.missing] if recording.missing else []
    if life.missing:
        notes.append(f"batches {range_text(life.missing)} of its inputs are missing: it is told up to there")
    discover()
    try:
        lived = ReplayedMind(batches[0])
        for batch in batches:
            if not _live(lived, batch, at):
                break
    except CannotReplay as error:
        raise NotRecorded(f"{file}: {error}") from None
    if at is not None and lived.now < at and lived.mind.cycle >= batches[-1].last:
        notes.append(f"it is told up to mission second {lived.now:.1f}: no more went into it after that")
    now = lived.now if at is None else max(lived.now, at)
    view = MindViews(lived.mind).view(LOOK, now)
    actions = tuple(_actions(recording, life, at))
    return replace(view, agent=lived.agent, program=lived.birth.program, actions=actions), notes


def _life(recording: Recording, agent: str, at: float | None) -> Life:
    """Return the life at a mission second: the last one that has begun by then."""
    parsed = (keys.parse(topic.key) for topic in recording.topics if topic.record == MindInputs.__name__)
    known = sorted({one[1] for one in parsed if one is not None})
    if agent not in known:
        hint = did_you_mean(agent, known) or ", nor of any other agent"
        raise NotRecorded(f"{recording.path}: there are no inputs of {agent} in it{hint}")
    lives = recording.lives(agent)
    births = [life.batches[0].birth if life.batches else None for life in lives]
    begun = [
        life for life, birth in zip(lives, births, strict=True) if at is None or birth is None or birth.start <= at
    ]
    return begun[-1] if begun else lives[0]


def _live(lived: ReplayedMind, batch: MindInputs, at: float | None) -> bool:
    """Replay a batch, up to a mission second. Returns whether more follows."""
    later = [] if at is None else [step.first for step in batch.steps if step.now > at]
    last = min([batch.last, *(first - 1 for first in later[:1])])
    lived.take(batch)
    while lived.mind.cycle < last:
        lived.cycle()
    if not later:
        lived.end_of_batch()
    return not later


def _actions(recording: Recording, life: Life, at: float | None) -> Iterable[ActivityEvent]:
    only = (keys.trace(life.fleet, life.agent, "activity"),)
    records = [one for _, one in recording.typed(MindActivity, only) if one.header.boot == life.boot]
    events = (event for record in records for event in record.events if event.kind in ("action", "outcome"))
    return [event for event in events if at is None or event.time <= at][-MOST_ACTIONS:]
