"""Directives that do not exist, and beliefs that were meant as directives."""

from __future__ import annotations

from collections.abc import Iterator

from agentd.check.finding_kinds import Kind, finding, warning
from agentd.check.symbol_table import Survey
from agentd.language.compiler.plan_patterns import PATTERNS, WrongPattern
from agentd.language.errors.suggestions import near
from agentd.language.syntax_tree.nodes import Directive, Number, String, Structure
from agentd.language.syntax_tree.printer import source_text
from schemas.files.findings import Finding

_ALONE = {
    "include": 'include needs a file, and maybe a namespace: { include("file.asl") }',
    "register_function": "register_function needs a name, how many arguments, and a rule: "
    '{ register_function("f", 2, "r") }',
    "namespace": "namespace needs a name: { begin namespace(n) } ... { end }",
}
_BLOCKS = frozenset(("namespace", *PATTERNS))


def wrong_directives(survey: Survey) -> Iterator[Finding]:
    """Directives that `agentd run` would refuse."""
    for directive in survey.directives:
        wrong = _wrong(directive)
        if wrong:
            yield finding(Kind.UNKNOWN_DIRECTIVE, directive.position, wrong)


def _wrong(directive: Directive) -> str:
    """What is wrong with a directive, or nothing."""
    name = directive.name.functor
    known = _ALONE if directive.items is None else _BLOCKS
    if name not in known:
        end = " ... { end }" if directive.items is not None else ""
        return f"there is no directive {{ {'begin ' if end else ''}{name} }}{end}{_near(name, directive)}"
    if name in PATTERNS:
        try:
            PATTERNS[name](directive.position, directive.name.args, directive.items or ())
        except WrongPattern as wrong:
            return f"the pattern {name} {wrong}"
    return "" if _complete(directive) else _ALONE[name]


def _near(name: str, directive: Directive) -> str:
    if directive.items is None and name in _BLOCKS:
        return f"; it encloses what it is about: {{ begin {source_text(directive.name)} }} ... {{ end }}"
    return near(name, _BLOCKS if directive.items is not None else _ALONE)


def _complete(directive: Directive) -> bool:
    match directive.name.functor, directive.name.args:
        case "include", (String(path),) | (String(path), Structure()):
            return "\0" not in path
        case "register_function", (String(), Number(), String()):
            return True
        case "namespace", (Structure(), *_):
            return True
        case name, _:
            return name in PATTERNS
    return False


def directives_as_beliefs(survey: Survey) -> Iterator[Finding]:
    """``include("f.asl").``, a belief."""
    for belief in survey.beliefs:
        match belief.literal:
            case Structure("include" | "register_function", (String(), *_)) as literal:
                directive = f"{{ {source_text(literal)} }}"
                text = f"{literal.functor}(...) is a belief here; a directive stands in braces: {directive}"
                yield warning(Kind.DIRECTIVE_AS_BELIEF, literal.position, text)
