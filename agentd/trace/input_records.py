"""What goes into a mind as records, and back: nothing may be lost, for a mind shall live again by them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from agentd.conversion.term_conversion import BadTerm, from_wire, to_wire
from agentd.language.compiler.compile import CompiledProgram, in_namespace
from agentd.language.terms.source_annotations import PERCEPT, SELF
from agentd.language.terms.terms import Literal
from agentd.mind.data.inputs import (
    ActionDone,
    BeliefAdded,
    GoalAdded,
    Mail,
    PerceptAdded,
    PerceptRemoved,
    PerceptReplaced,
    PerceptsChanged,
    SignalRaised,
    TeamReply,
    TimeRead,
    TooDeep,
)
from agentd.trace.environment_reads import CameBack, Given, Interrupted, MailRefused, NamesRead
from agentd.trace.program_sources import Sources, Texts
from schemas.wire.mind_records import MindInput
from schemas.wire.terms import Map, Term

KINDS: Final = {
    kind.__name__: kind
    for kind in (
        PerceptReplaced,
        PerceptAdded,
        PerceptRemoved,
        PerceptsChanged,
        Mail,
        ActionDone,
        TeamReply,
        GoalAdded,
        BeliefAdded,
        SignalRaised,
        TimeRead,
        TooDeep,
        NamesRead,
        MailRefused,
        CameBack,
        Interrupted,
    )
}
UNWRITTEN: Final = "Unwritten"
"""The kind of an input that has no form as a record; `why` says why."""


class Included:
    """A program that was read while the mind ran (`.include`): the answer's value, and what it was made of."""

    def __init__(self, program: CompiledProgram, path: str, namespace: str, sources: Sources) -> None:
        self.program, self.path, self.namespace, self.sources = program, path, namespace, sources


class Unreadable(ValueError):
    """A record of what went into a mind that says nothing to this version; says why."""


def written(cycle: int, item: Given, included: Mapping[int, Included]) -> MindInput:
    """Return an input as a record; `included` are the programs that were read at run time, by the request's id."""
    try:
        return MindInput(cycle=cycle, kind=type(item).__name__, fields=_fields(item, included))
    except (BadTerm, RecursionError) as bad:
        why = str(bad) if isinstance(bad, BadTerm) else "nested too deeply"
        return MindInput(cycle=cycle, kind=UNWRITTEN, fields={"of": type(item).__name__, "why": why})


def _fields(item: Given, included: Mapping[int, Included]) -> dict[str, Term]:
    match item:
        case PerceptReplaced() | PerceptRemoved():
            return {"literal": to_wire(item.literal), "key": list(map(float, item.key))}
        case PerceptAdded() | GoalAdded() | BeliefAdded() | SignalRaised() | Interrupted():
            return {"literal": to_wire(item.literal)}
        case PerceptsChanged():
            changed: list[Term] = []
            for (sig, args), literal in item.percepts.items():
                changed.append([to_wire(literal or Literal(sig, args)), literal is not None])
            return {"percepts": changed}
        case Mail():
            texts: dict[str, Term] = {"sender": item.sender, "performative": item.performative}
            return texts | {"content": to_wire(item.content), "id": item.msg_id, "in_reply_to": item.in_reply_to}
        case ActionDone():
            return {"id": item.id, "ok": item.ok, "reason": item.reason, "state": item.state, "cause": item.cause}
        case TeamReply():
            return _reply(item, included)
        case TimeRead():
            return {"seconds": item.seconds}
        case NamesRead():
            return {"names": list(item.names)}
        case MailRefused():
            return {"id": item.msg_id, "error": item.error, "message": item.message}
        case CameBack():
            return {"life": item.life, "interrupted": [to_wire(literal) for literal in item.interrupted]}
        case TooDeep():
            return {}


def _reply(item: TeamReply, included: Mapping[int, Included]) -> dict[str, Term]:
    fields: dict[str, Term] = {"id": item.id, "error": item.error, "message": item.message}
    if item.value is None:
        return fields
    if not isinstance(item.value, CompiledProgram):
        return fields | {"value": to_wire(item.value)}
    read = included.get(item.id)
    if read is None:
        raise BadTerm("the program that was included is not known")
    files = Map(tuple(read.sources.files.items()))
    return fields | {"program": read.path, "namespace": read.namespace, "files": files}


def read(record: MindInput) -> Given:
    """Return what went in. Raises Unreadable."""
    fields = record.fields
    if record.kind == UNWRITTEN:
        raise Unreadable(f"what went in at cycle {record.cycle} could not be recorded: {fields.get('why')}")
    kind = KINDS.get(record.kind)
    if kind is None:
        raise Unreadable(f"`{record.kind}`, which went in at cycle {record.cycle}, is not known to this version")
    try:
        return _item(kind, fields)
    except (KeyError, TypeError, ValueError, AttributeError) as bad:
        why = f"{type(bad).__name__}: {bad}"
        raise Unreadable(f"the {record.kind} that went in at cycle {record.cycle} cannot be read: {why}") from None


def _item(kind: type[Any], fields: dict[str, Any]) -> Given:
    if kind in (PerceptReplaced, PerceptRemoved):
        return kind(_literal(fields["literal"]), tuple(map(int, fields["key"])))  # type: ignore[no-any-return]
    if kind in (PerceptAdded, GoalAdded, BeliefAdded, SignalRaised, Interrupted):
        return kind(_literal(fields["literal"]))  # type: ignore[no-any-return]
    if kind is PerceptsChanged:
        pairs = [(_literal(term), holds) for term, holds in fields["percepts"]]
        return PerceptsChanged({(one.sig, one.args): one if holds else None for one, holds in pairs})
    if kind is Mail:
        content = from_wire(fields["content"])
        return Mail(fields["sender"], fields["performative"], content, fields["id"], fields["in_reply_to"])
    if kind is ActionDone:
        texts = fields["reason"], fields["state"], fields["cause"]
        return ActionDone(int(fields["id"]), bool(fields["ok"]), *texts)
    if kind is TeamReply:
        return TeamReply(int(fields["id"]), _value(fields), fields["error"], fields["message"])
    if kind is TimeRead:
        return TimeRead(float(fields["seconds"]))
    if kind is NamesRead:
        return NamesRead(tuple(fields["names"]))
    if kind is MailRefused:
        return MailRefused(fields["id"], fields["error"], fields["message"])
    if kind is CameBack:
        return CameBack(int(fields["life"]), tuple(map(_literal, fields["interrupted"])))
    return TooDeep()


def _value(fields: dict[str, Any]) -> Any:
    if "program" not in fields:
        return from_wire(fields["value"]) if "value" in fields else None
    texts = Texts(dict(fields["files"].entries))
    return in_namespace(texts.parse_file(fields["program"]), fields["namespace"], texts.parse_file)


def _literal(term: Any) -> Literal:
    found = from_wire(term)
    if type(found) is not Literal:
        raise TypeError(f"{found} is no literal")
    annots = found.annots
    for known in (PERCEPT, SELF):  # they are told by their identity
        if annots == known:
            return Literal(found.sig, found.args, known)
    return found
