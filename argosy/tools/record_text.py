"""Records as text: decode a payload by its Encoding or key, print a record in one line, read an action that was typed.

All tools print records by `line_of`. Terms are written as in programs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any

import msgspec

from schemas.humanize import shortened
from schemas.liveness import LAG_LATE
from schemas.manifest.loader import ActionDescription
from schemas.wire import keys
from schemas.wire.codec import MEDIA, BadRecord, Wire, codec, named_by
from schemas.wire.mind_records import (
    ActivityEvent,
    DecisionView,
    MindActivity,
    MindDecisions,
    MindInputs,
    MindOrder,
    MindView,
)
from schemas.wire.records import (
    Action,
    ActionStatus,
    BoardReport,
    BoardServices,
    Cancel,
    Health,
    LiveManifest,
    Mail,
    Mailboxes,
    ManifestChange,
    Outcome,
    Perception,
    Perceptions,
    Receipt,
    Record,
    RunningMission,
    RunState,
    ServiceRequest,
    StopOrder,
)
from schemas.wire.term_text import BadTerm, read, write
from schemas.wire.terms import Atom, Source, Structure, Term, Variable
from schemas.wire.vehicle_records import ParameterRequest, StoredPlan, VehicleParameters

SIGNS = {"replace": "", "add": "+", "remove": "-"}


def line_of(key: str, payload: bytes, encoding: str = "") -> str:
    """Return a payload of a key as one line; never raises."""
    try:
        record = read_record(key, payload, encoding)
        if record is None:
            return shortened(_unknown(payload, encoding))
        text = record_text(record)
        if isinstance(record, Perception) and not record.name:
            text = text.replace("?", key.partition("?")[0].rpartition("/")[2], 1)
        return shortened(text)
    except BadRecord as bad:
        return shortened(f"({bad})")


def record_text(record: Record) -> str:
    """Return a record as text."""
    match record:
        case Perception():
            return f"{SIGNS[record.update]}{write(Structure(record.name or '?', record.parameters))}"
        case Perceptions():
            return "; ".join(map(record_text, record.changes))
        case ActionStatus():
            return f"{write(Structure(record.name or '?', record.parameters))} {status_text(record)}"
        case Action():
            again = f", attempt {record.attempt}" if record.attempt > 1 else ""
            return f"{write(Structure(record.name or '?', record.parameters))}{again}"
        case ActionDescription():
            objection = f"; {record.problem}" if record.problem else ""
            return f"{record.signature} by {record.confirm or 'result'} within {record.deadline:g} s{objection}"
        case Health():
            return _health(record)
        case Mail():
            sent = (f"{one.sender} > {one.receiver} {one.performative} {write(one.content)}" for one in record.messages)
            return "; ".join(sent) or "no mail"
        case Receipt():
            reasons = [f"{place}: {why}" for place, why in (*record.refused.items(), *record.later.items())]
            return f"taken {record.taken}" + _list(", refused or later: ", reasons)
        case BoardServices():
            offers = (f"{name} ({', '.join(its)})" if its else name for name, its in record.agents.items())
            problem = f"; {record.problem}" if record.problem else ""
            return f"{record.board}: {', '.join(offers) or 'nobody'}" + _list("; found ", record.found) + problem
        case Mailboxes():
            waits = (f"{one.sender} > {one.receiver} {one.messages}" for one in record.queues)
            return f"{record.board}: {', '.join(waits) or 'no mail waits'}; {record.dead_count} given up"
        case LiveManifest():
            bad = "; ".join(record.problems)
            return f"{record.robot} version {record.version} of {record.file or 'no file'}" + (
                bad and f"; refused: {bad}"
            )
        case Outcome():
            return ("done" if record.ok else "NOT done") + (f": {record.reason}" if record.reason else "")
        case MindView() | MindInputs() | MindDecisions() | MindActivity():
            return _mind(record)
        case _:
            return _small(record)


def _small(record: Record) -> str:
    match record:
        case Cancel():
            return f"cancel {record.id}"
        case StopOrder():
            return record.order
        case RunningMission():
            return f"{record.file}, {len(record.text)} characters"
        case RunState():
            reason = f": {record.why}" if record.why else ""
            return f"{record.phase.replace('_', ' ')}{reason} ({record.mission_time:.1f} s)"
        case MindOrder():
            return f"{record.do} {record.text}".strip()
        case ServiceRequest():
            return f"{record.agent} {record.do} {record.service}".strip()
        case ManifestChange():
            changes = (f"{path} = {_json(value)}" for path, value in record.set.items())
            return ", ".join([*changes, *(f"without {path}" for path in record.remove)])
        case ParameterRequest():
            return f"{record.name} = {record.value:g}" + (", although it is for safety" if record.allow_safety else "")
        case VehicleParameters():
            one = "".join(f": {name} = {value:g}" for name, value in record.values.items() if record.of == 1)
            return f"{record.came} of {record.of} parameters{one}" + (record.problem and f"; {record.problem}")
        case StoredPlan():
            return f"{record.came} of {record.of} items" + (record.problem and f"; {record.problem}")
        case BoardReport():
            links = (f"{one.board} {one.answered}/{one.asked}" for one in record.links)
            free = f", {record.disk_free / 1e9:.1f} GB free" if record.disk_free is not None else ""
            return f"{record.board}: {record.state}{free}{_list('; links ', links)}"
    return f"{type(record).__name__} {_json(msgspec.to_builtins(record))}"


def status_text(status: ActionStatus) -> str:
    """Return a status as text: `running, altitude 3.2`, `refused: busy: goto is running`."""
    text = status.state.replace("_", " ")
    if status.state == "accepted" and status.deadline is not None:
        text += f", {status.deadline:g} s at most"
    if status.feedback and not status.final:
        text += "".join(f", {what} {value:.4g}" for what, value in status.feedback.items())
    if status.reason:
        text += f": {status.reason}" if status.final else f", waits for {status.reason}"
    return text


def _health(health: Health) -> str:
    parts = [f"{health.daemon or '?'} up {health.uptime:.0f} s", f"cpu {health.cpu:.1f} s"]
    for what, count in (("dropped", health.drops), ("bad input", health.bad_input), ("errors", health.errors)):
        parts += [f"{what} {count}"] if count else []
    if health.lag > LAG_LATE:
        parts.append(f"behind {health.lag:.1f} s")
    return ", ".join(parts) + _list("; ", (note.text for note in health.notes), "; ")


def _mind(record: MindView | MindInputs | MindDecisions | MindActivity) -> str:
    match record:
        case MindView():
            what = f"cycle {record.cycle} {record.state}, {len(record.beliefs) + record.beliefs_left_out} beliefs"
            goals = (f"{one.stack[-1] if one.stack else '?'} {one.state}" for one in record.intentions)
            return f"{record.agent}: {what}" + _list("; ", goals, "; ")
        case MindInputs():
            return f"{record.agent}: batch {record.number} to cycle {record.last}, {len(record.inputs)} inputs"
        case MindDecisions():
            parts = [*map(_decision, record.decisions), *(f"{one.formula}: {one.error}" for one in record.failures)]
        case MindActivity():
            parts = [_event(one) for one in record.events]
    return "; ".join(parts) + (f"; {record.left_out} left out" if record.left_out else "")


def _decision(decision: DecisionView) -> str:
    chosen = decision.chosen
    if chosen is None:
        return f"{decision.event}: no plan"
    return f"{decision.event}: {chosen.label or chosen.trigger}" + (f" ({chosen.position})" if chosen.position else "")


def _event(event: ActivityEvent) -> str:
    match event.kind:
        case "sent":
            return f"sent {event.other} {event.performative} {event.text}"
        case "received":
            return f"received of {event.other} {event.performative} {event.text}"
    text = " ".join(filter(None, (event.kind, event.text, event.state)))
    return text + (f": {event.reason}" if event.reason else "")


def _list(before: str, items: Iterable[str], between: str = ", ") -> str:
    text = between.join(items)
    return f"{before}{text}" if text else ""


def _unknown(payload: bytes, encoding: str) -> str:
    """Return a payload that is not one of our records: as JSON, as text, or its size."""
    if not payload:
        return "(empty)"
    try:
        return _json(plain(payload, encoding))
    except BadRecord:
        pass
    try:
        return payload.decode()
    except UnicodeDecodeError:
        return f"({len(payload)} bytes)"


def _json(value: Any) -> str:
    try:
        return msgspec.json.encode(value).decode()
    except (TypeError, ValueError, RecursionError):
        return repr(value)


MSGPACK = frozenset((*range(0x80, 0x90), 0xDE, 0xDF))
"""First bytes of a MessagePack map, as every record is; JSON does not begin so."""


def wire_of(payload: bytes, encoding: str = "") -> Wire:
    """Return the format of a payload."""
    if encoding.partition(";")[0] == MEDIA["msgpack"]:
        return "msgpack"
    return "msgpack" if payload[:1] and payload[0] in MSGPACK else "json"


def read_record(key: str, payload: bytes, encoding: str = "") -> Record | None:
    """Return the record of a payload; None if it is not one of ours. Raises BadRecord if it does not decode."""
    name, wire = named_by(encoding)[0], wire_of(payload, encoding)
    media = MEDIA[wire]
    if name:
        known = ActionDescription if name == ActionDescription.__name__ else keys.RECORDS.get(name)
        return codec(known).decode(payload, encoding) if known is not None else None
    fields = _fields(payload, wire)
    if fields is None:
        return None
    fitting = [(_knows(kind, fields), kind) for kind in candidates(key) if _required(kind) <= fields]
    problem: BadRecord | None = None
    for knows_all, kind in fitting:
        if knows_all or len(fitting) == 1:  # a newer sender may use unknown fields
            try:
                return codec(kind).decode(payload, media)
            except BadRecord as bad:
                problem = problem or bad
    if problem is not None:
        raise problem
    return None


def plain(payload: bytes, encoding: str = "") -> Any:
    """Return a payload as Python values. Raises BadRecord if it is neither JSON nor MessagePack."""
    try:
        if wire_of(payload, encoding) == "msgpack":
            return msgspec.msgpack.decode(payload)
        return msgspec.json.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadRecord(str(error)) from None


def candidates(key: str) -> tuple[type[Record], ...]:
    """Return the records that may be on a key, by the table of channels."""
    found: dict[type[Record], None] = {}
    for channel in keys.channels_of(key):
        described = ActionDescription if channel.carries is Action else None
        found.update(dict.fromkeys(filter(None, (channel.answers, channel.carries, described))))
    return tuple(found)


def _fields(payload: bytes, wire: Wire) -> set[str] | None:
    """Return the field names of a payload; None if it is not a map."""
    try:
        if wire == "msgpack":
            return set(msgspec.msgpack.decode(payload, type=dict[str, msgspec.Raw]))
        return set(msgspec.json.decode(payload, type=dict[str, msgspec.Raw]))
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None


def _knows(kind: type[Record], fields: set[str]) -> bool:
    """Whether a record type has all these fields."""
    return fields <= {one.encode_name for one in msgspec.structs.fields(kind)}


@cache
def _required(kind: type[Record]) -> set[str]:
    """Return the required fields of a record type."""
    return {one.encode_name for one in msgspec.structs.fields(kind) if one.required}


def read_action(text: str, words: Sequence[str]) -> tuple[str, tuple[Term, ...]]:
    """Return name and arguments of `takeoff` with the words `5`, or of `takeoff(5)` alone. Raises BadTerm."""
    if "(" not in text:
        return text, tuple(read_argument(word, f"argument {place}") for place, word in enumerate(words, 1))
    if words:
        raise BadTerm(f"`{text}` has its arguments in brackets: leave out `{words[0]}`")
    try:
        called = read(text)
    except BadTerm:
        called = read(text.replace("()", ""))  # `land()`, which the language does not know
    if isinstance(called, Atom):
        return called.name, ()
    if not isinstance(called, Structure) or called.negated or called.namespace or called.annotations:
        raise BadTerm(f"expected an action such as `takeoff(5)`, got `{text}`")
    return called.functor, tuple(_value(term, f"argument {place}") for place, term in enumerate(called.args, 1))


def read_argument(word: str, what: str) -> Term:
    """Return the value of a word, written as in a program. Raises BadTerm."""
    try:
        term = read(word)
    except BadTerm as bad:
        raise BadTerm(f"{what}: {bad}") from None
    return _value(term, what)


def _value(term: Term, what: str) -> Term:
    match term:
        case Variable(name=name, annotations=(), negated=False, namespace=""):
            return name  # a variable has no meaning here: GUIDED is meant as "GUIDED"
        case Variable() | Source():
            raise BadTerm(f"{what}: expected a value, got `{write(term)}`")
        case list():
            return [_value(item, what) for item in term]
        case Structure(args=args):
            for item in args:
                if isinstance(item, Variable | Source):
                    raise BadTerm(f"{what}: expected a value, got `{write(term)}`")
    return term
