"""What is wrong where no rule of the grammar goes on, in the words of someone who writes plans.

First the mistakes that show in a few tokens, then those that are told by the place in the grammar: `examples` holds bad
inputs with their messages, and an error in the same state of the parser at the same token gets the same message.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache

from agentd.language.examples import ANYWHERE, IN_THEIR_PLACE
from agentd.language.lalr import Stopped, machine
from agentd.language.lexer import END_OF_TEXT, Tokens, lexicon, tokenize
from agentd.language.source import Source

_NAMES = {
    "NAME": "a name",
    "QUOTED": "a quoted name",
    "VARIABLE": "a variable",
    "NUMBER": "a number",
    "STRING": "a string",
    "INTERNAL": "an internal action",
    "RELATION": "a comparison",
    "_END": "'.'",
    END_OF_TEXT: "the end of the text",
}


@dataclass(frozen=True, slots=True)
class Place:
    """The token that cannot stand where it does, and those around it."""

    source: Source
    tokens: Tokens
    index: int
    expected: Mapping[str, int]

    @property
    def kind(self) -> str:
        return self.tokens.types[self.index]

    @property
    def text(self) -> str:
        return self.tokens.texts[self.index]

    @property
    def before(self) -> str:
        """The text of the token before; empty at the beginning."""
        return self.tokens.texts[self.index - 1] if self.index else ""

    @property
    def kind_before(self) -> str:
        return self.tokens.types[self.index - 1] if self.index else ""

    @property
    def after(self) -> str:
        return self.tokens.texts[self.index + 1] if self.index + 1 < len(self.tokens.texts) else ""

    @property
    def adjoins(self) -> bool:
        """Whether no blank stands between the token and the one before it."""
        starts = self.tokens.starts
        return self.index > 0 and starts[self.index] == starts[self.index - 1] + len(self.before)

    @property
    def begins_line(self) -> bool:
        return self.index in self.tokens.first_in_line

    @property
    def found(self) -> str:
        return f"'{self.text}'" if self.text else "the end of the text"


def explain(source: Source, tokens: Tokens, index: int, states: list[int]) -> tuple[int, int, str]:
    """Line, column and message for the token at ``index``, for which the last of ``states`` has no action."""
    state = states[-1]
    place = Place(source, tokens, index, machine().tables.states[state])
    line, column = source.place(tokens.starts[index])
    if place.kind_before == "VARIABLE" and _only_scope(place):
        line, column = source.place(tokens.starts[index - 1])
        return line, column, _variable_alone(place)
    for tell in _TELLTALES:
        message = tell(place)
        if message:
            return line, column, message
    message = _of_example(states, place.kind)
    if message:
        message = message.replace("{found}", place.found).replace("{before}", f"'{place.before}'")
        return line, column, message
    return line, column, f"{place.found} cannot stand here{_after(place)}; expected {_expected(place.expected)}"


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
        if word and not (word == "trigger" and found[-1] == "trigger"):
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


# --- mistakes that show in a few tokens ------------------------------------------------------------------------------


def _keyword_as_name(place: Place) -> str | None:
    if place.text not in machine().tables.keywords or "NAME" not in place.expected:
        return None
    if place.text in ("else", "elif"):
        return f"an {place.text} without its if; no ; stands before {place.text}"
    if place.text == "not":
        if place.before == "not":
            return "not takes one formula without another not; write not (not a)"
        return None
    return f"'{place.text}' is a keyword and cannot be used as a name"


def _not_equal(place: Place) -> str | None:
    if place.text == "!" and place.after in ("=", "=="):
        return "inequality is written \\== and not !="
    return None


def _assignment(place: Place) -> str | None:
    if place.text == ":" and place.after == "=":
        return "a variable gets its value by = and not by :="
    return None


def _number_and_name(place: Place) -> str | None:
    if place.kind_before != "NUMBER" or not place.adjoins:
        return None
    if place.kind in ("NAME", "VARIABLE", "INTERNAL"):
        if place.before == "0" and place.text[0] in "xX":
            return f"there are no hexadecimal numbers: {place.before}{place.text}"
        return f"a name cannot begin with a digit: {place.before}{place.text}"
    if place.kind == "_END" and not _ends_line(place):
        return f"a number does not end with a dot; write {place.before} or {place.before}.0"
    return None


def _digit_for_name(place: Place) -> str | None:
    starts, texts = place.tokens.starts, place.tokens.texts
    if place.kind != "NUMBER" or "NAME" not in place.expected or "NUMBER" in place.expected or not place.after:
        return None
    if starts[place.index + 1] == starts[place.index] + len(place.text) and place.after[0].isalpha():
        return f"a name cannot begin with a digit: {place.text}{texts[place.index + 1]}"
    return None


def _only_scope(place: Place) -> bool:
    """Whether the variable before can only be the namespace of something."""
    return list(place.expected) == [machine().tables.fixed["::"]]


def _variable_alone(place: Place) -> str:
    operator = place.tokens.texts[place.index - 2] if place.index > 1 else ""
    if operator == "@":
        return "a plan label must be an atom; it begins with a small letter"
    if operator in ("!", "?"):
        return "a variable cannot be an initial goal; a name begins with a small letter"
    return "a variable cannot be a belief; a name begins with a small letter"


def _rule_arrow(place: Place) -> str | None:
    if place.text != ":-":
        return None
    for index in range(place.index - 1, -1, -1):
        if place.tokens.types[index] == "_END":
            break
        if place.tokens.texts[index] == "<-":
            return "a rule stands in a plan body only in braces: +{ head :- body }"
    return "a plan body is introduced by <- and not by :-"


def _variable_with_arguments(place: Place) -> str | None:
    if place.text == "(" and place.kind_before == "VARIABLE":
        return f"a variable cannot be followed by arguments; the name {place.before} must begin with a small letter"
    return None


def _internal_action(place: Place) -> str | None:
    if place.kind == "INTERNAL":
        if place.before == "~":
            return f"the internal action {place.text} cannot be strongly negated; write not {place.text}"
        if place.before in ("!", "!!", "?", "+", "-", "+<", "+>"):
            return f"{place.before} cannot be applied to an internal action; write {place.text} without it"
    if place.text == "[" and _functor_before(place) == "INTERNAL":
        return "an internal action cannot have annotations"
    return None


def _missing_dot(place: Place) -> str | None:
    if not place.begins_line or not place.index or place.kind_before == "_END":
        return None
    begins = place.text == "@" or (place.text in ("+", "-", "^") and place.after in ("!", "?"))
    follows = place.text in ("!", "?") and place.before in ("+", "-", "^")
    if begins or follows:
        return _NO_DOT
    return None


def _missing_dot_before_sign(place: Place) -> str | None:
    if place.text not in ("!", "?") or place.before not in ("+", "-"):
        return None
    if place.index - 1 in place.tokens.first_in_line:
        return _NO_DOT
    sign = place.before + place.text
    return f"{sign} begins a plan; is a '.' missing before it? in a body, a goal is {place.text}g"


_NO_DOT = "a plan begins here, but the one before it does not end with a '.'"


def _unclosed(place: Place) -> str | None:
    """Something that ends a formula or a plan comes while a bracket is open, or a bracket closes another."""
    if place.text not in (";", ".", "<-", ":-", "}", ")", "]", "") or place.text == _CLOSERS.get(place.before):
        return None
    opened = _open_bracket(place)
    if opened is None:
        return f"a {place.text} that nothing opens" if place.text in (")", "]", "}") else None
    bracket = place.tokens.texts[opened]
    closer = _CLOSERS[bracket]
    line, column = place.source.place(place.tokens.starts[opened])
    if place.text == closer or (bracket == "{" and place.text in (";", ".", "<-", ":-")):
        return None
    end = place.found if place.text else "the end of the text"
    return f"the '{bracket}' of line {line}, column {column} is not closed before {end}; expected '{closer}'"


_CLOSERS = {"(": ")", "[": "]", "{": "}"}


def _open_bracket(place: Place) -> int | None:
    """The index of the innermost bracket that is open at the token."""
    closers: list[str] = []
    texts = place.tokens.texts
    for index in range(place.index - 1, -1, -1):
        text = texts[index]
        if text in (")", "]", "}"):
            closers.append(text)
        elif text in _CLOSERS:
            if not closers:
                return index
            closers.pop()
    return None


def _functor_before(place: Place) -> str:
    """The type of the token before the arguments that end before the place."""
    index = place.index - 1
    if index >= 0 and place.tokens.texts[index] == ")":
        depth = 0
        while index >= 0:
            text = place.tokens.texts[index]
            depth += (text == ")") - (text == "(")
            index -= 1
            if depth == 0:
                break
    return place.tokens.types[index] if index >= 0 else ""


def _ends_line(place: Place) -> bool:
    return place.index + 1 in place.tokens.first_in_line or place.tokens.types[place.index + 1] == END_OF_TEXT


_TELLTALES: tuple[Callable[[Place], str | None], ...] = (
    _keyword_as_name,
    _not_equal,
    _assignment,
    _number_and_name,
    _digit_for_name,
    _variable_with_arguments,
    _internal_action,
    _missing_dot,
    _missing_dot_before_sign,
    _rule_arrow,
    _unclosed,
)


# --- what could stand there ------------------------------------------------------------------------------------------


def _after(place: Place) -> str:
    return f" after '{place.before}'" if place.before else ""


def _expected(row: Mapping[str, int]) -> str:
    """The tokens that a state has actions for, the alike ones by one word."""
    tables = machine().tables
    texts = {kind: text for text, kind in (*tables.fixed.items(), *tables.keywords.items())}
    kinds = {kind for kind in row if kind in texts or kind in _NAMES}
    if not kinds >= _ITEM:
        kinds.discard(END_OF_TEXT)  # only a text that is one plan could end elsewhere
    names: list[str] = []
    for group, word in _GROUPS:
        if group <= kinds:
            names.append(word)
            kinds -= group | _PART_OF.get(word, frozenset())
    names += [_NAMES.get(kind) or f"'{texts[kind]}'" for kind in sorted(kinds, key=lambda k: (k != "_END", k))]
    if len(names) > 6:
        names = [*names[:6], "..."]
    return " or ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


_TERM = frozenset(("NUMBER", "STRING", "NAME", "VARIABLE"))
_IN_TERM = frozenset(
    ("QUOTED", "INTERNAL", "TRUE", "FALSE", "TILDE", "LPAR", "LSQB", "LBRACE", "PLUS", "MINUS", "PLUS_PLUS")
) | frozenset(("MINUS_MINUS", "MINUS_PLUS", "__ANON_5", "NOT"))
_STEP = frozenset(("BANG", "BANG_BANG", "QUERY", "IF", "WHILE", "FOR", "ADD_FIRST", "ADD_LAST"))
_OPERATORS = frozenset(("PLUS", "MINUS", "TIMES", "DIVIDE", "POWER", "DIV", "MOD"))
_ITEM = frozenset(("AT", "BANG", "NAME", "PLUS"))
_GROUPS: tuple[tuple[frozenset[str], str], ...] = (
    (_ITEM, "a belief, a goal, a plan"),
    (_TERM | _STEP, "a formula of a plan body"),
    (_TERM, "a term"),
    (_OPERATORS, "an operator"),
    (frozenset(("NAME", "VARIABLE")), "a literal or variable"),
    (frozenset(("NAME",)), "a literal"),
)
_PART_OF = {
    "a belief, a goal, a plan": frozenset(
        ("QUOTED", "TILDE", "__ANON_5", "VARIABLE", "MINUS", "CARET", "LBRACE", "QUERY")
    ),
    "a formula of a plan body": _IN_TERM,
    "a term": _IN_TERM,
    "an operator": frozenset(("PLUS_PLUS", "MINUS_MINUS", "MINUS_PLUS", "RELATION", "AMPERSAND", "VBAR")),
    "a literal or variable": frozenset(("QUOTED", "TILDE", "__ANON_5")),
    "a literal": frozenset(("QUOTED", "TILDE", "__ANON_5", "VARIABLE")),
}
