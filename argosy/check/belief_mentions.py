"""The beliefs that a program mentions or a formula tests: a belief that nobody mentions never holds."""

from __future__ import annotations

from typing import Any

from agentd.check.programs import Includes
from agentd.language.syntax_tree.nodes import And, Directive, Formula, Not, Or, Program, Structure
from agentd.language.syntax_tree.signatures import DEFAULT
from agentd.language.syntax_tree.traversal import walk
from agentd.runtime.program_paths import SourcePaths


def mentioned(program: Program) -> set[tuple[str, int]]:
    """Return functor and arity of every structure in a program and the files that it includes, anywhere."""
    includes = Includes(program.file, SourcePaths(), [])  # the survey reports what is wrong with them
    found: set[tuple[str, int]] = set()
    waiting: list[Any] = [program]
    while waiting:
        for node in walk(waiting.pop()):
            if isinstance(node, Structure):
                found.add((node.functor, len(node.args)))
            elif isinstance(node, Directive) and node.name.functor == "include":
                waiting += includes(node, DEFAULT)
    return found


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
