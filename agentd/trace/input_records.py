"""The inputs of a mind as records and back, without loss: a recorded mind is rebuilt from them.

Besides `agentd.mind.data.inputs` a mind reads its environment: who can be sent to, whether a message was accepted, and
what a restart has found. Replayed, it must read the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeAlias

from agentd.conversion.term_conversion import BadTerm, from_wire, to_wire
from agentd.language.compiler.compile import CompiledProgram, compile_program
from agentd.language.terms.source_annotations import PERCEPT, SELF
from agentd.language.terms.terms import Literal
from agentd.mind.data import inputs
from agentd.trace.initial_state import Sources, parser_of
from schemas.wire.mind_records import MindInput
from schemas.wire.terms import Map, Term

UNWRITTEN: Final = "Unwritten"
"""The kind of an input that no record can hold; its field `why` says why."""


@dataclass(slots=True)
class NamesRead:
    """The names that can be sent to, in order; recorded when the program asks and they have changed."""

    names: tuple[str, ...]


@dataclass(slots=True)
class MailRefused:
    """The outbox did not accept a message: the plan that sent it has failed."""

    msg_id: str
    error: str
    message: str


@dataclass(slots=True)
class CameBack:
    """A restored mind was notified of its restart, before its first cycle (`agentd.persistence.restore.come_back`)."""

    life: int
    interrupted: tuple[Literal, ...]


@dataclass(slots=True)
class Interrupted:
    """An action of before a restart has ended, and no plan waited for it."""

    literal: Literal


Reading: TypeAlias = NamesRead | MailRefused | CameBack | Interrupted
Given: TypeAlias = inputs.Input | Reading
"""Everything that a mind is given."""


class Included:
    """A program that was read at run time (`.include`): the value of the reply, and its sources."""

    def __init__(self, program: CompiledProgram, path: str, namespace: str, sources: Sources) -> None:
        self.program, self.path, self.namespace, self.sources = program, path, namespace, sources


class Unreadable(ValueError):
    """A record of an input that this version cannot read; the text says why."""


def _literal(term: Any) -> Literal:
    found = from_wire(term)
    if type(found) is not Literal:
        raise TypeError(f"{found} is no literal")
    for known in (PERCEPT, SELF):  # compared by identity elsewhere
        if found.annots == known:
            return Literal(found.sig, found.args, known)
    return found


def _changes_written(changes: dict[Any, Literal | None]) -> list[Term]:
    return [[to_wire(one or Literal(sig, args)), one is not None] for (sig, args), one in changes.items()]


def _changes_read(pairs: list[Any]) -> dict[Any, Literal | None]:
    literals = [(_literal(term), holds) for term, holds in pairs]
    return {(one.sig, one.args): one if holds else None for one, holds in literals}


class _Field(NamedTuple):
    """One field of an input."""

    name: str
    """In the record."""
    attribute: str
    write: Callable[[Any], Term] = lambda value: value
    read: Callable[[Any], Any] = lambda value: value


def _plain(*names: str) -> tuple[_Field, ...]:
    return tuple(_Field(name, name) for name in names)


_LITERAL: Final = _Field("literal", "literal", to_wire, _literal)
_KEY: Final = _Field("key", "key", lambda key: list(map(float, key)), lambda key: tuple(map(int, key)))
_NUMBER: Final = _Field("id", "id", read=int)
_IDENTITY: Final = _Field("id", "msg_id")
_FIELDS: Final[dict[type[Any], tuple[_Field, ...]]] = {
    inputs.PerceptReplaced: (_LITERAL, _KEY),
    inputs.PerceptAdded: (_LITERAL,),
    inputs.PerceptRemoved: (_LITERAL, _KEY),
    inputs.PerceptsChanged: (_Field("percepts", "percepts", _changes_written, _changes_read),),
    inputs.Mail: (
        *_plain("sender", "performative"),
        _Field("content", "content", to_wire, from_wire),
        _IDENTITY,
        *_plain("in_reply_to"),
    ),
    inputs.ActionDone: (_NUMBER, _Field("ok", "ok", read=bool), *_plain("reason", "state", "cause")),
    inputs.TeamReply: (_NUMBER, *_plain("error", "message")),
    inputs.GoalAdded: (_LITERAL,),
    inputs.BeliefAdded: (_LITERAL,),
    inputs.SignalRaised: (_LITERAL,),
    inputs.TimeRead: (_Field("seconds", "seconds", read=float),),
    inputs.TooDeep: (),
    NamesRead: (_Field("names", "names", list, tuple),),
    MailRefused: (_IDENTITY, *_plain("error", "message")),
    CameBack: (
        _Field("life", "life", read=int),
        _Field(
            "interrupted", "interrupted", lambda some: list(map(to_wire, some)), lambda some: tuple(map(_literal, some))
        ),
    ),
    Interrupted: (_LITERAL,),
}
"""The fields of each kind of input. The value of a TeamReply is handled apart: it may be a program."""
KINDS: Final = {kind.__name__: kind for kind in _FIELDS}


def written(cycle: int, item: Given, included: Mapping[int, Included]) -> MindInput:
    """Return an input as a record; `included` are the programs that were read at run time, by the request's id."""
    kind = type(item)
    try:
        fields: dict[str, Term] = {one.name: one.write(getattr(item, one.attribute)) for one in _FIELDS[kind]}
        if isinstance(item, inputs.TeamReply) and item.value is not None:
            fields |= _value_written(item, included)
        return MindInput(cycle=cycle, kind=kind.__name__, fields=fields)
    except (BadTerm, RecursionError) as bad:
        why = str(bad) if isinstance(bad, BadTerm) else "nested too deeply"
        return MindInput(cycle=cycle, kind=UNWRITTEN, fields={"of": kind.__name__, "why": why})


def _value_written(reply: inputs.TeamReply, included: Mapping[int, Included]) -> dict[str, Term]:
    if not isinstance(reply.value, CompiledProgram):
        return {"value": to_wire(reply.value)}
    read = included.get(reply.id)
    if read is None:
        raise BadTerm("the program that was included is not known")
    files = Map(tuple(read.sources.files.items()))
    return {"program": read.path, "namespace": read.namespace, "files": files}


def read(record: MindInput) -> Given:
    """Return the input of a record. Raises Unreadable."""
    fields: dict[str, Any] = record.fields
    if record.kind == UNWRITTEN:
        raise Unreadable(f"the input of cycle {record.cycle} could not be recorded: {fields.get('why')}")
    kind = KINDS.get(record.kind)
    if kind is None:
        raise Unreadable(f"the input `{record.kind}` of cycle {record.cycle} is not known to this version")
    try:
        values = {one.attribute: one.read(fields[one.name]) for one in _FIELDS[kind]}
        if kind is inputs.TeamReply:
            values["value"] = _value_read(fields)
        item: Given = kind(**values)
    except (KeyError, TypeError, ValueError, AttributeError) as bad:
        why = f"{type(bad).__name__}: {bad}"
        raise Unreadable(f"the input {record.kind} of cycle {record.cycle} cannot be read: {why}") from None
    return item


def _value_read(fields: dict[str, Any]) -> Any:
    if "program" not in fields:
        return from_wire(fields["value"]) if "value" in fields else None
    parse = parser_of(dict(fields["files"].entries))
    return compile_program(parse(fields["program"]), parse, namespace=fields["namespace"])
