"""The beliefs that a program mentions or a formula tests: a belief that nobody mentions never holds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from agentd.check.programs import Includes
from agentd.language.syntax_tree.nodes import And, Directive, Formula, Not, Or, Program, Structure, fields_of
from agentd.language.syntax_tree.signatures import DEFAULT
from agentd.runtime.program_paths import SourcePaths


def mentioned(program: Program) -> set[tuple[str, int]]:
    """Return functor and arity of every structure in a program and the files that it includes, anywhere."""
    includes = Includes(program.file, SourcePaths(), [])  # the survey reports what is wrong with them
    found: set[tuple[str, int]] = set()
    waiting: list[Any] = [program]
    while waiting:
        for node in nodes_of(waiting.pop()):
            if isinstance(node, Structure):
                found.add((node.functor, len(node.args)))
            elif isinstance(node, Directive) and node.name.functor == "include":
                waiting += includes(node, DEFAULT)
    return found


def nodes_of(tree: Any) -> Iterator[Any]:
    """Yield every node of a syntax tree, the tree itself among them, in no particular order."""
    waiting: list[Any] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, tuple | list):
            waiting += node
        elif names := fields_of(type(node)):
            yield node
            waiting += (getattr(node, name) for name in names)


def beliefs_of(formula: Formula) -> set[tuple[str, int]]:
    """Return functor and arity of the beliefs that a formula asks for."""
    found: set[tuple[str, int]] = set()
    waiting: list[Any] = [formula]
    while waiting:
        match waiting.pop():
            case Structure(functor=functor, args=args):
                found.add((functor, len(args)))
            case Not(operand=inner):
                waiting.append(inner)
            case And(left=left, right=right) | Or(left=left, right=right):
                waiting += (left, right)
            case _:
                pass
    return found
