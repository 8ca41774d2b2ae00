"""What each token of AgentSpeak is to a reader: one table for the Pygments lexer and the TextMate grammar.

The tokens are those of the grammar (`agentd.language.parser.parse_tables`), the names of internal actions and
functions those of the library (`agentd.stdlib`), so that neither can be forgotten here: a token without a class is an
error.
"""

from __future__ import annotations

from enum import Enum
from typing import Final, NamedTuple


class Look(NamedTuple):
    """How something is shown: a token type of Pygments, and a scope of TextMate without the language at its end."""

    pygments: str
    scope: str


class Class(Enum):
    """Kinds of tokens that readers distinguish."""

    COMMENT = Look("Comment", "comment")
    STRING = Look("String.Double", "string.quoted.double")
    QUOTED = Look("String.Symbol", "constant.other.atom.quoted")
    NUMBER = Look("Number", "constant.numeric")
    TRUTH = Look("Keyword.Constant", "constant.language")
    CONTROL = Look("Keyword", "keyword.control")
    WORD = Look("Operator.Word", "keyword.operator.word")
    DIRECTIVE = Look("Keyword.Namespace", "keyword.control.directive")
    LABEL = Look("Name.Decorator", "entity.name.label")
    BUILTIN = Look("Name.Builtin", "support.function.builtin")
    INTERNAL = Look("Name.Function.Magic", "support.function.other")
    CALL = Look("Name.Function", "entity.name.function")
    NAME = Look("Name", "constant.other.atom")
    VARIABLE = Look("Name.Variable", "variable.other")
    GOAL = Look("Operator.Word", "keyword.operator.goal")
    CHANGE = Look("Operator.Word", "keyword.operator.event")
    ARROW = Look("Keyword.Declaration", "keyword.operator.arrow")
    OPERATOR = Look("Operator", "keyword.operator")
    PUNCTUATION = Look("Punctuation", "punctuation")


OF_TYPE: Final = {
    "COMMENT": Class.COMMENT,
    "STRING": Class.STRING,
    "QUOTED": Class.QUOTED,
    "NUMBER": Class.NUMBER,
    "INTERNAL": Class.INTERNAL,
    "NAME": Class.NAME,
    "VARIABLE": Class.VARIABLE,
    "RELATION": Class.OPERATOR,
    "_END": Class.PUNCTUATION,
}
OF_WORD: Final = {
    "true": Class.TRUTH,
    "false": Class.TRUTH,
    "div": Class.WORD,
    "mod": Class.WORD,
    "not": Class.WORD,
    "if": Class.CONTROL,
    "elif": Class.CONTROL,
    "else": Class.CONTROL,
    "while": Class.CONTROL,
    "for": Class.CONTROL,
}
OF_SIGN: Final = {
    **dict.fromkeys(("!", "!!", "?", "^"), Class.GOAL),
    **dict.fromkeys(("+", "-", "++", "--", "-+", "+<", "+>"), Class.CHANGE),
    **dict.fromkeys(("<-", ":-", "<:", ":", "|||", "|&|"), Class.ARROW),
    **dict.fromkeys(("*", "/", "**", "~", "&", "|", "::"), Class.OPERATOR),
    **dict.fromkeys(("{", "}", "(", ")", "[", "]", ";", ",", "@"), Class.PUNCTUATION),
}
DIRECTIVES: Final = ("begin", "end", "include", "register_function")
"""The words that begin a directive: `{ include("flying.asl") }`."""
BLANK: Final = "BLANK"


def library_names() -> list[str]:
    """Return the internal actions and functions of the library: `.print`, `math.abs`; none that packages have added."""
    import agentd.stdlib
    from agentd.mind.data.registry import ACTIONS, FUNCTIONS

    named = [(name, action.function) for name, actions in ACTIONS.items() for action in actions]
    named += [(name, function) for (name, _), function in FUNCTIONS.items()]
    return sorted({name for name, made in named if made.__module__.startswith(agentd.stdlib.__name__)})
