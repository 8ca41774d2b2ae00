"""Rebuild a mind as it was at a moment of a recording, by replaying its recorded inputs up to then."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from msgspec.structs import replace

from agentd.conversion.mind_view import MOST_BELIEFS, Look, MindViews
from agentd.extensions.plugins import discover
from agentd.replay.replayed_mind import CannotReplay, ReplayedMind
from argosy.cli.errors import CommandError
from argosy.recording.mind_inputs import RecordedMind, range_text
from argosy.recording.player import MOST_ACTIONS
from argosy.recording.reader import Recording
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
    recording = Recording(file)
    recorded, place, count = _mind_at(recording, agent, at)
    batches = recorded.unbroken
    if not batches or batches[0].initial is None:
        raise NotRecorded(f"{file}: the start of {agent} is missing: begin to record before the agent starts")
    notes = [recording.missing] if recording.missing else []
    if count > 1:
        notes.append(f"{agent} was started {count} times and counts from each start: this is the {place}. time")
    if recorded.missing:
        notes.append(f"batches {range_text(recorded.missing)} of its inputs are missing: the explanation ends there")
    discover()
    try:
        rebuilt = ReplayedMind(batches[0])
        for batch in batches:
            if not _replay(rebuilt, batch, at):
                break
    except CannotReplay as error:
        raise NotRecorded(f"{file}: {error}") from None
    if at is not None and rebuilt.now < at and rebuilt.mind.cycle >= batches[-1].last:
        notes.append(f"the explanation ends at mission second {rebuilt.now:.1f}: no later input is recorded")
    now = rebuilt.now if at is None else max(rebuilt.now, at)
    view = MindViews(rebuilt.mind).view(LOOK, now)
    actions = tuple(_actions(recording, recorded, at))
    return replace(view, agent=rebuilt.agent, program=rebuilt.initial.program, actions=actions), notes


def _mind_at(recording: Recording, agent: str, at: float | None) -> tuple[RecordedMind, int, int]:
    """Return the last recorded mind that has begun by a mission second; its place, from 1, and of how many."""
    known = sorted({name for _, name in recording.names_of(MindInputs)})
    if agent not in known:
        hint = did_you_mean(agent, known) or ", nor of any other agent"
        raise NotRecorded(f"{recording.path}: there are no inputs of {agent} in it{hint}")
    minds = recording.minds(agent)
    initials = [recorded.batches[0].initial if recorded.batches else None for recorded in minds]
    begun = [place for place, initial in enumerate(initials, 1) if at is None or initial is None or initial.start <= at]
    place = begun[-1] if begun else 1
    return minds[place - 1], place, len(minds)


def _replay(rebuilt: ReplayedMind, batch: MindInputs, at: float | None) -> bool:
    """Replay a batch, up to a mission second. Returns whether more follows."""
    later = [] if at is None else [step.first for step in batch.steps if step.now > at]
    last = min([batch.last, *(first - 1 for first in later[:1])])
    rebuilt.take(batch)
    while rebuilt.mind.cycle < last:
        rebuilt.cycle()
    if not later:
        rebuilt.end_of_batch()
    return not later


def _actions(recording: Recording, recorded: RecordedMind, at: float | None) -> Iterable[ActivityEvent]:
    only = (keys.trace(recorded.fleet, recorded.agent, "activity"),)
    records = [one for _, one in recording.typed(MindActivity, only) if one.header.boot == recorded.boot]
    events = (event for record in records for event in record.events if event.kind in ("action", "outcome"))
    return [event for event in events if at is None or event.time <= at][-MOST_ACTIONS:]
