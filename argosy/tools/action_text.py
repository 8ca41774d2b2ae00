"""Actions as people type them: words of a shell, or one text as a program writes it."""

from __future__ import annotations

from collections.abc import Sequence

from schemas.files.findings import did_you_mean
from schemas.wire.term_text import BadTerm, read, write
from schemas.wire.terms import Atom, Source, Structure, Term, Variable


def read_action(text: str, words: Sequence[str]) -> tuple[str, tuple[Term, ...]]:
    """Return name and arguments of `takeoff` with the words `5`, or of `takeoff(5)` alone. Raises BadTerm."""
    if "(" not in text:
        return text, tuple(read_argument(word, f"argument {place}") for place, word in enumerate(words, 1))
    if words:
        raise BadTerm(f"expected the arguments in the brackets of `{text}` or behind it, got `{words[0]}` besides")
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
    """Return the value that a word says, as a program writes it. Raises BadTerm."""
    try:
        term = read(word)
    except BadTerm as bad:
        raise BadTerm(f"{what}: {bad}") from None
    return _value(term, what)


def called(name: str, parameters: Sequence[Term]) -> str:
    """Return an action or a percept as a program writes it: `takeoff(5)`, `land`."""
    return f"{name}({', '.join(map(write, parameters))})" if parameters else name


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


def unknown(what: str, name: str, there: Sequence[str]) -> str:
    """Say that there is nothing of a name, and what there is."""
    hint = did_you_mean(name, there)
    return f"there is no {what} `{name}`{hint}" + (f" Known are {', '.join(sorted(there))}" if "?" in hint else "")
