"""What is wrong where no rule of the grammar goes on, in the words of someone who writes plans.

First the mistakes that show in a few tokens, then those that are told by the place in the grammar: `examples` holds bad
inputs with their messages, and an error in the same state of the parser at the same token gets the same message.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache

from agentd.language.endings import capital_action, change_without_semicolon
from agentd.language.errors import shown
from agentd.language.examples import ANYWHERE, IN_THEIR_PLACE
from agentd.language.expected import expected
from agentd.language.lalr import Stopped, machine
from agentd.language.lexer import Tokens, lexicon, tokenize
from agentd.language.place import Place
from agentd.language.source import Source
from agentd.language.telltales import TELLTALES, only_scope, variable_alone


def explain(source: Source, tokens: Tokens, index: int, states: list[int]) -> tuple[int, int, str]:
    """Line, column and message for the token at ``index``, for which the last of ``states`` has no action."""
    place = Place(source, tokens, index, machine().accepted(states))
    line, column = source.place(tokens.starts[index])
    if place.kind_before == "VARIABLE" and only_scope(place) and not capital_action(place):
        line, column = source.place(tokens.starts[index - 1])
        return line, column, variable_alone(place)
    earlier = change_without_semicolon(place)
    if earlier is not None and earlier < index:
        return *source.place(tokens.starts[earlier]), f"a ; is missing before '{tokens.texts[earlier]}'"
    for tell in TELLTALES:
        message = tell(place)
        if message:
            return line, column, message
    message = _of_example(states, place.kind)
    if message:
        message = message.replace("{found}", place.found).replace("{before}", f"'{shown(place.before)}'")
        return line, column, message
    if not place.text:
        item = {"": "program", "braces": "directive"}.get(place.part, place.part)
        return line, column, f"the text ends in the middle of a {item}; expected {expected(place.expected)}"
    after = f" after '{shown(place.before)}'" if place.before else ""
    return line, column, f"{place.found} cannot stand here{after}; expected {expected(place.expected)}"


def _of_example(states: list[int], kind: str) -> str | None:
    """The message of the example that goes wrong at the same token in the same surroundings, if there is one."""
    surroundings = _surroundings(states)
    best: tuple[int, str | None] = (-1, None)
    for theirs, message in _known_places().get((states[-1], kind), ()):
        alike = 0
        while alike < min(len(theirs), len(surroundings)) and theirs[-1 - alike] == surroundings[-1 - alike]:
            alike += 1
        if alike > best[0] and (alike or not theirs):
            best = (alike, message)
    return best[1]


def _surroundings(states: list[int]) -> list[str]:
    """What is open around a place, outermost first: a body, a context, brackets, ..."""
    entered_by, words = machine().entered_by, _surrounding_symbols()
    found = ["program"]
    for state in states[1:]:
        symbol = entered_by[state]
        word = words.get(symbol)
        if symbol in ("PLUS", "MINUS", "CARET"):
            word = "trigger" if found[-1] in ("program", "body", "label") else None
        if word in (")", "]"):
            while found[-1] not in ("(", "[") and len(found) > 1:
                found.pop()
            if len(found) > 1:
                found.pop()  # what is closed surrounds nothing
        elif word and not (word == "trigger" and found[-1] == "trigger"):
            found.append(word)
    return found


@lru_cache(maxsize=1)
def _surrounding_symbols() -> dict[str, str]:
    """The symbols that say what surrounds a place, with the word for it."""
    fixed = machine().tables.fixed
    texts = {"<-": "body", "{": "body", "@": "label", "label": "label", "goal_trigger": "trigger"}
    words = {fixed.get(text, text): word for text, word in texts.items()}
    words |= {"belief_trigger": "trigger", "trigger": "trigger"}
    words |= {fixed[text]: text for text in (":", "<:", ":-", "(", ")", "[", "]", "|", "!", "!!", "?", "~", "::")}
    return words | {kind: kind for kind in ("IF", "WHILE", "FOR", "ELSE", "ELIF")}


@lru_cache(maxsize=1)
def _known_places() -> dict[tuple[int, str], list[tuple[list[str], str]]]:
    """Where in the grammar, and in what surroundings, each example goes wrong; made for the first error."""
    known: dict[tuple[int, str], list[tuple[list[str], str]]] = {}
    lexical = lexicon(machine().tables)
    for text, message in IN_THEIR_PLACE + ANYWHERE:
        tokens = tokenize(Source(text, ""), lexical)

        def note(
            index: int,
            states: list[int],
            at_item: bool,
            tokens: Tokens = tokens,
            text: str = text,
            message: str = message,
        ) -> None:
            place = (states[-1], tokens.types[index])
            around = _surroundings(states) if (text, message) in IN_THEIR_PLACE else []
            known.setdefault(place, []).append((around, message))

        with suppress(Stopped):
            machine().run(tokens, "program", _Nothing(), note)
    return known


class _Nothing:
    """A builder that builds nothing."""

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *_: None
