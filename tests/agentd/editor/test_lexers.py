"""The Pygments lexers and the TextMate grammar: nothing is forgotten, nothing lost, and both see the same."""

import json
import plistlib
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from pygments.token import Error, Name, Text

from agentd.editor import textmate
from agentd.editor.lexer import AgentSpeakLexer, ProjectLexer, classed
from agentd.editor.token_classes import BLANK, OF_SIGN, OF_TYPE, OF_WORD, Class, library_names
from agentd.language.parse import parse_program
from agentd.language.parser.lexer import BROKEN
from agentd.language.parser.parse_tables import load
from agentd.mind.data import registry

ROOT = Path(__file__).parents[3]
SAMPLE = """\
/* two
   lines */
{ include("flying.asl") }
{ begin namespace(local) }
aloft :- altitude(A) & A >= 2.5e-1 | not ~landed(_).
!start.  // begins
@careful[atomic] +!go(X)[source(Who)] : X \\== 'home base' <- !!up; ?where(Y); -+at(Y * math.abs(-2) ** 2);
   .print("to ", X, '\\''); .my_own.action(X); if (X mod 2 == 0) { takeoff(5) } elif (true) { land }; ns::mark.
{ end }
"""


def programs() -> list[Path]:
    folders = ("missions", "examples", "tests", "benchmarks")
    found = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.asl"))]
    assert len(found) > 400
    return found


@cache
def texts() -> list[tuple[str, str]]:
    return [(str(path.relative_to(ROOT)), path.read_bytes().decode("utf-8-sig", "replace")) for path in programs()]


def parses(text: str) -> bool:
    try:
        parse_program(text, "x.asl")
    except Exception:  # programs with mistakes are among them on purpose
        return False
    return True


def test_each_token_of_the_grammar_has_a_class() -> None:
    tables = load()
    assert set(tables.patterns) - {BLANK} == set(OF_TYPE)
    assert set(tables.keywords) == set(OF_WORD)
    assert set(tables.fixed) == set(OF_SIGN)


def test_every_program_comes_out_as_it_went_in_and_what_parses_has_no_error_tokens() -> None:
    lexer, parsed = AgentSpeakLexer(), 0
    for name, text in texts():
        pieces = list(lexer.get_tokens_unprocessed(text))
        assert "".join(piece for _, _, piece in pieces) == text, name
        ends = 0
        for at, _, piece in pieces:
            assert at == ends, name
            ends += len(piece)
        if any(kind is Error for _, kind, _ in pieces):
            assert not parses(text), name
        else:
            parsed += 1
    assert parsed > 400


def test_what_is_no_token_is_an_error_and_the_rest_is_still_read() -> None:
    pieces = [(kind, piece) for _, kind, piece in AgentSpeakLexer().get_tokens_unprocessed('a(§). b("open\n). c.')]
    assert [piece for kind, piece in pieces if kind is Error] == ["§", '"']
    assert "c" in [piece for kind, piece in pieces if kind is Name]


@pytest.mark.parametrize(
    ("piece", "of"),
    [
        ("/* two\n   lines */", Class.COMMENT),
        ("// begins", Class.COMMENT),
        ("include", Class.DIRECTIVE),
        ("end", Class.DIRECTIVE),
        ('"flying.asl"', Class.STRING),
        ("careful", Class.LABEL),
        ("go", Class.CALL),
        ("start", Class.NAME),
        ("!", Class.GOAL),
        ("!!", Class.GOAL),
        ("?", Class.GOAL),
        ("-+", Class.CHANGE),
        ("<-", Class.ARROW),
        (":-", Class.ARROW),
        ("2.5e-1", Class.NUMBER),
        ("A", Class.VARIABLE),
        ("_", Class.VARIABLE),
        ("not", Class.WORD),
        ("mod", Class.WORD),
        ("if", Class.CONTROL),
        ("true", Class.TRUTH),
        ("'home base'", Class.QUOTED),
        (".print", Class.BUILTIN),
        ("math.abs", Class.BUILTIN),
        (".my_own.action", Class.INTERNAL),
        ("\\==", Class.OPERATOR),
        ("::", Class.OPERATOR),
        (";", Class.PUNCTUATION),
    ],
)
def test_each_kind_of_token_is_recognised(piece: str, of: Class) -> None:
    assert {kind for _, kind, text in classed(SAMPLE) if text == piece} == {of}


def test_the_names_of_the_library_are_known() -> None:
    names = library_names()
    assert {".print", ".send", ".findall", "math.cos"} <= set(names)
    assert all("." in name for name in names)


def test_a_project_file_comes_out_as_it_went_in() -> None:
    text = 'MAS two {\n  // who\n  agents: bob #2 [x="y"]; Ann;\n  infrastructure: Local\n}\n'
    pieces = list(ProjectLexer().get_tokens_unprocessed(text))
    assert "".join(piece for _, _, piece in pieces) == text
    assert not any(kind is Error for _, kind, _ in pieces)


def test_pygments_knows_both_lexers() -> None:
    points = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]["pygments.lexers"]
    found = set()
    for target in points.values():
        module, _, name = target.partition(":")
        found.add(getattr(import_module(module), name))
    assert found == {AgentSpeakLexer, ProjectLexer}


# --- the TextMate grammar


def test_the_files_of_the_grammar_are_of_the_present_language() -> None:
    for path, text in ((textmate.JSON_FILE, textmate.json_text()), (textmate.PLIST_FILE, textmate.plist_text())):
        assert path.read_text(encoding="utf-8") == text, f"python -m {textmate.__name__} rewrites it"
    assert plistlib.loads(textmate.PLIST_FILE.read_bytes())["patterns"] == textmate.grammar()["patterns"]


def test_what_a_package_has_registered_is_no_part_of_the_language(monkeypatch: pytest.MonkeyPatch) -> None:
    before = library_names()
    monkeypatch.setattr(registry, "FUNCTIONS", {**registry.FUNCTIONS, ("mylib.twice", 1): lambda mind, of: 2 * of})
    assert library_names() == before


def test_the_extension_names_its_files() -> None:
    folder = textmate.FOLDER / "vscode"
    package = json.loads((folder / "package.json").read_text())["contributes"]
    (language,), (shown,) = package["languages"], package["grammars"]
    assert (folder / language["configuration"]).is_file()
    assert (folder / shown["path"]).samefile(textmate.JSON_FILE)
    assert shown["scopeName"] == textmate.grammar()["scopeName"]
    assert language["extensions"] == [".asl"]
    json.loads((folder / language["configuration"]).read_text())


def test_its_expressions_mean_the_same_to_python_oniguruma_and_javascript() -> None:
    for rule in textmate.grammar()["patterns"]:
        for key in ("match", "begin", "end"):
            pattern = rule.get(key, "")
            re.compile(pattern)
            assert "\n" not in pattern
            # no lookbehind, no named or atomic groups, no possessive quantifiers, no modes, no \w and its kind
            assert not re.search(r"\(\?(?!:|!|=)|[*+?}]\+|\\[wWdDsSbBhHAZzGkRpP]|\[\[:|&&", pattern), pattern


Span = tuple[int, int, str]


def spans(text: str) -> Iterator[Span]:
    """What an editor makes of a text by the grammar: line by line, the earliest match, of equal ones the first rule."""
    rules = [
        ({key: re.compile(rule[key]) for key in ("match", "begin", "end") if key in rule}, rule)
        for rule in textmate.grammar()["patterns"]
    ]
    firsts = [patterns.get("match") or patterns["begin"] for patterns, _ in rules]
    inside: tuple[dict[str, re.Pattern[str]], dict[str, Any]] | None = None
    start = 0
    for line in text.splitlines(keepends=True):
        at = 0
        hits = [first.search(line) for first in firsts]
        while at < len(line):
            if inside is not None:
                end = inside[0]["end"].search(line, at)
                upto = len(line) if end is None else end.end()
                yield start + at, start + upto, inside[1]["name"]
                at, inside = upto, inside if end is None else None
                continue
            hits = [
                hit if hit is None or hit.start() >= at else firsts[i].search(line, at) for i, hit in enumerate(hits)
            ]
            found = min(((hit.start(), number, hit) for number, hit in enumerate(hits) if hit), default=None)
            if found is None:
                break
            match, (patterns, rule) = found[2], rules[found[1]]
            if "begin" in rule:
                inside = (patterns, rule)
                yield start + match.start(), start + match.end(), rule["name"]
            elif "captures" in rule:
                for number, capture in rule["captures"].items():
                    yield start + match.start(int(number)), start + match.end(int(number)), capture["name"]
            else:
                yield start + match.start(), start + match.end(), rule["name"]
            at = max(match.end(), at + 1)
        start += len(line)


def test_the_grammar_sees_every_program_as_the_lexer_does() -> None:
    """Character by character; blanks and what is no token aside."""
    seen = 0
    for name, text in [("the sample", SAMPLE), *texts()]:
        pieces = list(classed(text))
        if "\x0c" in text or "\r" in text or any(kind == BROKEN for _, kind, _ in pieces):
            continue  # lines end otherwise there
        scopes = [""] * len(text)
        for begin, end, scope in spans(text):
            scopes[begin:end] = [scope] * (end - begin)
        for at, kind, piece in pieces:
            if isinstance(kind, Class):
                expected = kind.value.scope
                got = {scope for scope, char in zip(scopes[at : at + len(piece)], piece, strict=True) if char.strip()}
                if kind is Class.COMMENT:
                    got = {"comment.asl" for scope in got if scope.startswith("comment.")}
                assert got == {f"{expected}.asl"}, (name, piece)
                seen += 1
    assert seen > 50_000


def test_blanks_are_blanks() -> None:
    kinds = {kind for _, kind, piece in AgentSpeakLexer().get_tokens_unprocessed(SAMPLE) if not piece.strip()}
    assert kinds == {Text.Whitespace}
