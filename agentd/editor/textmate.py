"""The TextMate grammar of AgentSpeak, for VS Code and others: ``python -m agentd.editor.textmate`` rewrites it.

Its expressions are those of the language's own lexer. They keep to what Python, Oniguruma and JavaScript share, and
each matches within a line; comments of several lines have a begin and an end.
"""

from __future__ import annotations

import json
import plistlib
import re
from itertools import groupby
from pathlib import Path
from typing import Any, Final

from agentd.editor.token_classes import DIRECTIVES, OF_SIGN, OF_TYPE, OF_WORD, Class, library_names
from agentd.language.parser.parse_tables import Tables, load

LANGUAGE: Final = "asl"
FOLDER: Final = Path(__file__).parents[2] / "deploy" / "editor"
JSON_FILE: Final = FOLDER / "vscode" / "syntaxes" / "asl.tmLanguage.json"
PLIST_FILE: Final = FOLDER / "AgentSpeak.tmLanguage"

_AFTER_WORD: Final = r"(?![a-zA-Z0-9_])"
_AFTER_NAME: Final = r"(?![a-zA-Z0-9_]|\.[a-zA-Z_])"


def grammar(tables: Tables | None = None) -> dict[str, Any]:
    """Return the grammar as data."""
    tables = tables or load()
    return {
        "$schema": "https://raw.githubusercontent.com/martinring/tmlanguage/master/tmlanguage.json",
        "name": "AgentSpeak",
        "scopeName": f"source.{LANGUAGE}",
        "fileTypes": [LANGUAGE],
        "patterns": [
            {"match": r"//[^\n]*", "name": f"comment.line.double-slash.{LANGUAGE}"},
            {"begin": r"/\*", "end": r"\*/", "name": f"comment.block.{LANGUAGE}"},
            _match(_one_line(tables.patterns["STRING"]), Class.STRING),
            *_in_context(tables.patterns["NAME"]),
            *_names(tables),
            *(_match(_one_line(tables.patterns[kind]), OF_TYPE[kind]) for kind in ("VARIABLE", "NUMBER", "QUOTED")),
            _match(tables.patterns["RELATION"], OF_TYPE["RELATION"]),
            *_signs(tables),
            _match(tables.patterns["_END"], OF_TYPE["_END"]),
            {"match": r"[^ \t\r\n]", "name": f"invalid.illegal.{LANGUAGE}"},
        ],
    }


def _scope(of: Class) -> str:
    return f"{of.value.scope}.{LANGUAGE}"


def _match(pattern: str, of: Class) -> dict[str, Any]:
    return {"match": pattern, "name": _scope(of)}


def _one_line(pattern: str) -> str:
    """A pattern with line feeds written as `\\n`, as the grammar has them."""
    return pattern.replace("\n", r"\n")


def _in_context(name: str) -> list[dict[str, Any]]:
    """Labels and directives: a name after a sign."""
    sign = {"name": _scope(Class.PUNCTUATION)}
    words = "|".join(DIRECTIVES)
    return [
        {"match": rf"(@)[ \t]*({name})", "captures": {"1": sign, "2": {"name": _scope(Class.LABEL)}}},
        {
            "match": rf"(\{{)[ \t]*({words}){_AFTER_WORD}",
            "captures": {"1": sign, "2": {"name": _scope(Class.DIRECTIVE)}},
        },
    ]


def _names(tables: Tables) -> list[dict[str, Any]]:
    """Internal actions, reserved words, and names with and without arguments, in this order as in the lexer."""
    library = "|".join(re.escape(name) for name in sorted(library_names(), key=len, reverse=True))
    by_class = groupby(sorted(tables.keywords, key=lambda word: OF_WORD[word].name), OF_WORD.__getitem__)
    words = [(of, "|".join(sorted(group, key=len, reverse=True))) for of, group in by_class]
    name = tables.patterns["NAME"]
    return [
        _match(f"(?:{library}){_AFTER_NAME}", Class.BUILTIN),
        _match(tables.patterns["INTERNAL"], Class.INTERNAL),
        *(_match(f"(?:{text}){_AFTER_WORD}", of) for of, text in words),
        _match(rf"{name}(?=\()", Class.CALL),
        _match(name, Class.NAME),
    ]


def _signs(tables: Tables) -> list[dict[str, Any]]:
    """Return the signs, longer ones first, since of several rules that match the first counts."""
    signs = sorted(tables.fixed, key=lambda sign: (-len(sign), OF_SIGN[sign].name, sign))
    by_kind = groupby(signs, lambda sign: (len(sign), OF_SIGN[sign]))
    return [_match("|".join(re.escape(sign) for sign in group), of) for (_, of), group in by_kind]


def json_text() -> str:
    """Return the grammar as a file of JSON."""
    return json.dumps(grammar(), indent=2) + "\n"


def plist_text() -> str:
    """Return the grammar as a property list, for editors that read no JSON."""
    data = {key: value for key, value in grammar().items() if not key.startswith("$")}
    data["uuid"] = "5a1c7a4e-6d0b-4c55-9a0e-3f0a6b2f7d11"
    return plistlib.dumps(data, sort_keys=False).decode()


def write() -> None:
    """Write both files."""
    JSON_FILE.parent.mkdir(parents=True, exist_ok=True)
    JSON_FILE.write_text(json_text(), encoding="utf-8")
    PLIST_FILE.write_text(plist_text(), encoding="utf-8")


if __name__ == "__main__":
    write()
