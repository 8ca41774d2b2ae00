"""A MkDocs hook: colours for AgentSpeak (`asl`), which Pygments does not know, and for project files (`mas2j`)."""

from __future__ import annotations

from typing import Any, ClassVar

from pygments.lexer import RegexLexer
from pygments.lexers import LEXERS, _lexer_cache
from pygments.token import Comment, Keyword, Name, Number, Operator, Punctuation, String, Text


class AgentSpeakLexer(RegexLexer):
    name = "AgentSpeak"
    aliases: ClassVar[list[str]] = ["asl"]
    filenames: ClassVar[list[str]] = ["*.asl"]
    tokens: ClassVar[dict[str, Any]] = {
        "root": [
            (r"\s+", Text),
            (r"//.*?$", Comment.Single),
            (r"/\*(?s:.*?)\*/", Comment.Multiline),
            (r'"(?:\\.|[^"\\])*"', String),
            (r"@[A-Za-z]\w*", Name.Decorator),
            (r"\{\s*(?:begin|end|include|register_function)\b", Keyword.Namespace),
            (r"\b(?:not|true|false|self|percept|if|else|elif|while|for|div|mod)\b", Keyword),
            (r"<-|:-|[-+^]?[-+]?!!?(?=[a-z(A-Z~])|[-+?]?[-+](?=[a-z~])|\?(?=[a-z~(])", Operator.Word),
            (r"\.?[a-z]\w*(?:\.\w+)*(?=\()", Name.Function),
            (r"\.[a-z]\w*", Name.Builtin),
            (r"[A-Z]\w*|_\w*", Name.Variable),
            (r"\d+(?:\.\d+)?(?:[eE][-+]?\d+)?", Number),
            (r"~?[a-z]\w*", Name),
            (r"\\==|=\.\.|[<>=]=|[-+*/<>=&|:;^~]", Operator),
            (r".", Punctuation),
        ]
    }


class ProjectLexer(AgentSpeakLexer):
    name = "Jason project"
    aliases: ClassVar[list[str]] = ["mas2j"]
    filenames: ClassVar[list[str]] = ["*.mas2j"]


def on_startup(**_: Any) -> None:
    """Make both known to Pygments, which has a place for lexers of packages but none for those of a folder."""
    for lexer in (AgentSpeakLexer, ProjectLexer):
        LEXERS[lexer.__name__] = (__name__, lexer.name, tuple(lexer.aliases), tuple(lexer.filenames), ())
        _lexer_cache[lexer.name] = lexer
