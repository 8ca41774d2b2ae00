"""Parse tables: what lark makes of `grammar.lark`, kept as a file so that an agent starts without lark.

Importing lark and analysing the grammar costs a quarter of a second and 12 MB in every agent; reading the tables costs
two milliseconds. ``grammar.json`` carries the digest of the grammar that it was made from: when the grammar has been
edited since, the tables are made again, in memory. ``python -m agentd.language.parser.parse_tables`` rewrites the file.
"""

from __future__ import annotations

import json
import re
import zlib
from functools import lru_cache
from pathlib import Path
from typing import Any

from msgspec import Struct, to_builtins

STARTS = ("program", "lone_expression", "lone_literal", "lone_plan", "lone_trigger")
"""The symbols that a text can be asked to be."""

GRAMMAR = "grammar.lark"
TABLES = "grammar.json"


class RuleTable(Struct, frozen=True):
    """One alternative of a rule: how many symbols it takes off the stack, and which of them the builder gets.

    ``children`` holds an index into these symbols, or -1 for an optional part that is absent here. ``name`` is the
    rule's alias or its name; ``transparent`` rules hand their only child on unchanged; ``listing`` rules (lark's
    ``_rules``) only gather children for the rule that uses them, where ``spliced`` indices name such symbols.
    """

    origin: str
    name: str
    size: int
    children: list[int]
    spliced: list[int]
    transparent: bool
    listing: bool


class Tables(Struct, frozen=True):
    """An LALR(1) automaton with its tokens.

    ``states[s]`` maps a terminal to its action (``n >= 0``: shift and go to n; ``n < 0``: reduce by rule ``~n``) and a
    rule's name to the state that follows it. ``patterns`` are tried in order; ``fixed`` gives the type of operators,
    ``keywords`` the type of reserved words; ``ignored`` are the types between tokens.
    """

    digest: str
    patterns: dict[str, str]
    fixed: dict[str, str]
    keywords: dict[str, str]
    ignored: list[str]
    rules: list[RuleTable]
    states: list[dict[str, int]]
    starts: dict[str, int]
    ends: dict[str, int]


def _resource(name: str) -> str:
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


@lru_cache(maxsize=1)
def load() -> Tables:
    """Return the tables of the present grammar; built with lark only if the shipped ones are of another grammar."""
    grammar = _resource(GRAMMAR)
    try:
        data = json.loads(_resource(TABLES))
    except (OSError, ValueError):
        return compile_grammar(grammar)
    if data["digest"] != _digest(grammar):
        return compile_grammar(grammar)
    data["rules"] = [RuleTable(*row) for row in data["rules"]]
    return Tables(**data)


def dump(tables: Tables) -> str:
    """Return the text of ``grammar.json``."""
    data = to_builtins(tables)
    data["rules"] = [list(rule.values()) for rule in data["rules"]]
    lines = [f"{json.dumps(key)}: {_rows(value)}" for key, value in data.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _rows(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "[\n" + ",\n".join(json.dumps(row, separators=(",", ":")) for row in value) + "\n]"
    return json.dumps(value)


def _digest(grammar: str) -> str:
    return f"{zlib.crc32(grammar.encode()):08x}"


def compile_grammar(grammar: str) -> Tables:
    """Analyse a grammar with lark. Raises lark's GrammarError when it is not LALR(1)."""
    from lark import Lark
    from lark.grammar import Rule
    from lark.lexer import TerminalDef

    lark = Lark(grammar, parser="lalr", lexer="basic", start=list(STARTS), maybe_placeholders=True)
    data, memo = lark.memo_serialize([TerminalDef, Rule])
    automaton = data["parser"]["parser"]
    rules = {key: entry for key, entry in memo.items() if entry["__type__"] == "Rule"}
    terminals = [entry for entry in memo.values() if entry["__type__"] == "TerminalDef"]
    name_pattern = next(t["pattern"]["value"] for t in terminals if t["name"] == "NAME")
    patterns: dict[str, str] = {}
    fixed: dict[str, str] = {}
    keywords: dict[str, str] = {}
    for terminal in terminals:
        text = terminal["pattern"]["value"]
        if terminal["pattern"]["__type__"] != "PatternStr":
            patterns[terminal["name"]] = text
        elif re.fullmatch(name_pattern, text):
            keywords[text] = terminal["name"]
        else:
            fixed[text] = terminal["name"]
    numbers = {key: index for index, key in enumerate(rules)}
    symbols = automaton["tokens"]
    reduce = 1
    states = {
        state: {
            symbols[symbol]: ~numbers[target["@"]] if action == reduce else target
            for symbol, (action, target) in row.items()
        }
        for state, row in automaton["states"].items()
    }
    starts, ends = automaton["start_states"], automaton["end_states"]
    order = _order(states, [starts[symbol] for symbol in STARTS])
    scalars = _scalars(list(rules.values()))
    return Tables(
        digest=_digest(grammar),
        patterns=patterns,
        fixed=fixed,
        keywords=keywords,
        ignored=list(lark.ignore_tokens),
        rules=[_rule_table(rule, scalars) for rule in rules.values()],
        states=[
            {symbol: order[to] if to >= 0 else to for symbol, to in sorted(states[number].items())} for number in order
        ],
        starts={symbol: order[starts[symbol]] for symbol in STARTS},
        ends={symbol: order[ends[symbol]] for symbol in STARTS},
    )


def _order(states: dict[int, dict[str, int]], starts: list[int]) -> dict[int, int]:
    """Number the states by the grammar alone (lark's numbers depend on the hashes of its process)."""
    order: dict[int, int] = {}
    pending = starts[::-1]
    while pending:
        state = pending.pop()
        if state not in order:
            order[state] = len(order)
            pending += [
                states[state][symbol] for symbol in sorted(states[state], reverse=True) if states[state][symbol] >= 0
            ]
    return order


def _kept(rule: dict[str, Any]) -> list[int]:
    """Return the indices of the symbols that a tree would hold: rules, and terminals that have a name."""
    return [i for i, symbol in enumerate(rule["expansion"]) if not symbol.get("filter_out", False)]


def _scalars(rules: list[dict[str, Any]]) -> set[str]:
    """Return the ``_rules`` that always have exactly one child (``_target: literal | variable``)."""
    scalars = {rule["origin"]["name"] for rule in rules if rule["origin"]["name"].startswith("_")}
    while True:
        refuted = {
            rule["origin"]["name"]
            for rule in rules
            if rule["origin"]["name"] in scalars
            and not (len(kept := _kept(rule)) == 1 and _is_one(rule["expansion"][kept[0]], scalars))
        }
        if not refuted:
            return scalars
        scalars -= refuted


def _is_one(symbol: dict[str, Any], scalars: set[str]) -> bool:
    return symbol["__type__"] == "Terminal" or not symbol["name"].startswith("_") or symbol["name"] in scalars


def _rule_table(rule: dict[str, Any], scalars: set[str]) -> RuleTable:
    origin = rule["origin"]["name"]
    expansion = rule["expansion"]
    kept = _kept(rule)
    absent = _absent_before(rule["options"]["empty_indices"], len(expansion))
    children: list[int] = []
    for index in range(len(expansion)):
        children += [-1] * absent[index]
        if index in kept:
            children.append(index)
    children += [-1] * absent[len(expansion)]
    expands = rule["options"]["expand1"] and not rule["alias"]
    return RuleTable(
        origin=origin,
        name=rule["alias"] or origin,
        size=len(expansion),
        children=children,
        spliced=[i for i in kept if not _is_one(expansion[i], scalars)],
        transparent=len(children) == 1 and children[0] >= 0 and (expands or origin in scalars),
        listing=origin.startswith("_") and origin not in scalars,
    )


def _absent_before(empty_indices: tuple[bool, ...], size: int) -> list[int]:
    """Return the number of absent optional parts before each symbol, and after the last one."""
    if not empty_indices:
        return [0] * (size + 1)
    counts = [0]
    for absent in empty_indices:
        if absent:
            counts[-1] += 1
        else:
            counts.append(0)
    return counts


if __name__ == "__main__":
    import sys

    sys.stdout.write(dump(compile_grammar(_resource(GRAMMAR))))
