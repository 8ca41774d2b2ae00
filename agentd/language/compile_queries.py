"""Internal actions whose argument is a query, written as loops: ``.findall``, ``.setof``, ``.count``, ``.min`` ..."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from agentd.language import syntax
from agentd.language.compile_match import Next
from agentd.language.compile_terms import Scope
from agentd.language.variables import variables

if TYPE_CHECKING:
    from agentd.language.compile_formula import FormulaCompiler

Writer = Callable[["FormulaCompiler", syntax.InternalAction, Scope, Next], bool]
"""Writes a call; False when its arguments are not of the kind, and the internal action itself must decide."""

_FORMULAS = (syntax.Structure, syntax.InternalAction, syntax.Relation, syntax.Not, syntax.And, syntax.Or)


def is_query(node: Any, scope: Scope) -> bool:
    """Whether an argument is a formula that can be compiled here (or a variable that will hold one)."""
    return isinstance(node, _FORMULAS) or (isinstance(node, syntax.Variable) and node.name in scope)


def _collect(compiler: FormulaCompiler, node: syntax.InternalAction, scope: Scope) -> tuple[str, Scope]:
    """Write the loop that collects the instances of the first argument over the solutions of the second.

    Returns the local with them, and the scope with the variables that only the first argument has: all share those.
    """
    function = compiler.function
    asked = variables(node.args[1])
    scope = dict(scope)
    for name in variables(node.args[0]):
        if name not in asked:
            compiler.build(syntax.Variable(name), scope)
    found = function.assign("[]", "l")
    mark = function.assign("len(trail)", "t")

    def take(inner: Scope) -> None:
        item = function.assign(compiler.build(node.args[0], dict(inner)))
        function.emit(f"{found}.append({item} if type({item}) is float else resolve({item}))")

    compiler.each(node.args[1], scope, take)
    function.emit(f"if len(trail) > {mark}: undo(trail, {mark})")
    return found, scope


def _findall(compiler: FormulaCompiler, node: syntax.InternalAction, scope: Scope, then: Next) -> bool:
    if not is_query(node.args[1], scope):
        return False
    found, scope = _collect(compiler, node, scope)
    result = compiler.function.assign(f"make_list({found})")
    compiler.match(node.args[2], result, scope, then)
    return True


def _setof(compiler: FormulaCompiler, node: syntax.InternalAction, scope: Scope, then: Next) -> bool:
    if not is_query(node.args[1], scope):
        return False
    found, scope = _collect(compiler, node, scope)
    result = compiler.function.assign(f"make_list(distinct({found}))")
    compiler.match(node.args[2], result, scope, then)
    return True


def _extreme(end: str) -> Writer:
    def write(compiler: FormulaCompiler, node: syntax.InternalAction, scope: Scope, then: Next) -> bool:
        if not is_query(node.args[1], scope):
            return False
        found, scope = _collect(compiler, node, scope)
        with compiler.function.block(f"if {found}:"):
            result = compiler.function.assign(f"ordered({found})[{end}]")
            compiler.match(node.args[2], result, scope, then)
        return True

    return write


def _count(compiler: FormulaCompiler, node: syntax.InternalAction, scope: Scope, then: Next) -> bool:
    if not is_query(node.args[0], scope):
        return False
    mark = compiler.function.assign("len(trail)", "t")
    result = compiler.count(node.args[0], scope)
    compiler.function.emit(f"if len(trail) > {mark}: undo(trail, {mark})")
    compiler.match(node.args[1], result, scope, then)
    return True


def _eval(compiler: FormulaCompiler, node: syntax.InternalAction, scope: Scope, then: Next) -> bool:
    if not is_query(node.args[1], scope):
        return False
    name = compiler.helper(node.args[1], scope, [], "return True")
    mark = compiler.function.assign("len(trail)", "t")
    call = f"{name}({', '.join(['m', 'trail', *compiler.passed(node.args[1], scope)])})"
    result = compiler.function.assign(f"TRUE if {call} else FALSE")
    compiler.function.emit(f"undo(trail, {mark})")
    compiler.match(node.args[0], result, scope, then)
    return True


QUERIES: Final[dict[tuple[str, int], Writer]] = {
    (".findall", 3): _findall,
    (".setof", 3): _setof,
    (".min", 3): _extreme("0"),
    (".max", 3): _extreme("-1"),
    (".count", 2): _count,
    (".eval", 2): _eval,
}
"""The writers by name and arity."""
