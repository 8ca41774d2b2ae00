"""The subject of a question: a goal, a belief or an action, with or without sign, arity and arguments."""

from __future__ import annotations

import re
from dataclasses import dataclass

from argosy.why.wording import sign_of, unquoted, without_annotations
from schemas.files.findings import Findings

_WRITTEN = re.compile(
    r"(?P<sign>[-+^]*[!?]*)(?P<name>~?(?:[a-zA-Z_]\w*::)?\.?[a-z]\w*(?:\.\w+)*)"
    r"(?:/(?P<arity>[0-9]+)|(?P<args>\(.*\)))?(?:\[.*\])?",
    re.DOTALL,
)


@dataclass(frozen=True)
class Subject:
    """A name, with the further conditions of the question."""

    text: str
    """As asked."""
    name: str
    arity: int | None = None
    args: tuple[str, ...] = ()
    goal: str = ""
    """`!` or `?` if it was asked so, else empty: any."""
    fails: bool = False
    """It has a minus: the question is only about the end of a belief, or a failure."""

    def is_named(self, indicator: str) -> bool:
        """Whether an indicator such as `go/1` or `+!go/1` is the subject's."""
        name, _, arity = sign_of(indicator)[1].rpartition("/")
        return name == self.name and (self.arity is None or str(self.arity) == arity)

    def is_of(self, text: str) -> bool:
        """Whether an event, belief or formula, as text, is about the subject."""
        sign, name, args = parts_of(text)
        if name != self.name or (self.arity is not None and self.arity != len(args)):
            return False
        if self.goal and sign and self.goal not in sign:
            return False
        if self.fails and sign and not sign.startswith("-"):
            return False
        return all(_agree(mine, its) for mine, its in zip(self.args, args, strict=False))


def subject_of(text: str) -> Subject:
    """Read a subject. Raises Findings if no goal, belief or action can have this name."""
    written = _WRITTEN.fullmatch(text.strip())
    if written is None:
        expected = "expected the name of a goal, a belief or an action: go, go/1, '!go(3,_)'"
        raise Findings.about("argosy why", f"`{text}`: {expected}")
    sign = written["sign"]
    args: tuple[str, ...] = ()
    arity = int(written["arity"]) if written["arity"] is not None else None
    if written["args"] is not None:
        args = taken_apart(f"f{written['args']}")[1]
        arity = len(args)
    goal = "!" if "!" in sign else "?" if "?" in sign else ""
    return Subject(text.strip(), written["name"], arity, args, goal, sign.startswith("-"))


def parts_of(text: str) -> tuple[str, str, tuple[str, ...]]:
    """Return sign, functor and arguments of a formula: `+!`, `go` and `3` of `+!go(3)[source(bob)]`."""
    sign, rest = sign_of(without_annotations(text))
    return (sign, *taken_apart(rest))


def taken_apart(text: str) -> tuple[str, tuple[str, ...]]:
    """Return functor and arguments of a literal as text: `go` and `3`, `f(_)` of `go(3,f(_))`."""
    name, bracket, rest = text.partition("(")
    if not bracket or not rest.rstrip().endswith(")"):
        return text.strip(), ()
    args, depth, begin = [], 0, 0
    inner = rest.rstrip()[:-1]
    for place, character in unquoted(inner):
        if character in "([{":
            depth += 1
        elif character in ")]}":
            depth -= 1
        elif character == "," and depth == 0:
            args.append(inner[begin:place].strip())
            begin = place + 1
    args.append(inner[begin:].strip())
    return name.strip(), tuple(args)


def _agree(asked: str, written: str) -> bool:
    """Whether an argument matches the asked one: a variable matches all, a number an equal one."""
    if re.fullmatch(r"[A-Z_]\w*", asked):
        return True
    try:
        return float(asked) == float(written)
    except ValueError:
        return re.sub(r"\s+", "", asked) == re.sub(r"\s+", "", written)
