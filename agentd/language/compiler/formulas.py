"""Generates Python for formulas: contexts, rule bodies, tests and conditions.

A conjunction becomes nested loops, each literal one loop over the belief base; where Python would nest too deep, for
alternatives and under ``not``, the formula becomes a function of its own. A continuation writes the code that follows a
success, in the innermost block.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any, Final

from msgspec.structs import replace

from agentd.language.compiler.code_writer import Function, Ref, targets_of, tuple_of
from agentd.language.compiler.compile_terms import Scope
from agentd.language.compiler.constants import is_constant, signature_of
from agentd.language.compiler.matching import MAX_INDENT, MatchCompiler, Next
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.traversal import is_plain_variable, variables

_MAX_LOOPS = 8
"""So deep loops nest in one function; beyond, a generator takes over."""
_MOST_CONJUNCTS = 6
"""A longer conjunction is split into generators."""


class FormulaCompiler(MatchCompiler):
    """Writes formulas into one function, which has the locals ``m`` (the mind) and ``trail``."""

    nested = False
    """Whether the function is called from the loops of another one."""
    rows: list[str] | None = None
    """While a ``for`` is written: expressions for the facts that a solution rests on."""

    def formula(self, node: nodes.Term, scope: Scope, then: Next) -> None:
        """Write a formula; ``then`` is written once, where it holds, and may be reached several times."""
        if self.function.indent > MAX_INDENT or self.function.loops > _MAX_LOOPS:
            self._apart(node, scope, then)
            return
        match node:
            case nodes.And() if len(parts := conjuncts(node)) > _MOST_CONJUNCTS:
                half = len(parts) // 2
                first, second = _conjunction(parts[:half]), _conjunction(parts[half:])
                self._apart(first, scope, lambda inner: self._apart(second, inner, then))
            case nodes.And(left=left, right=right):
                self.formula(left, scope, lambda inner: self.formula(right, inner, then))
            case nodes.Or():
                self._apart(node, scope, then)
            case nodes.Not(operand=operand):
                self._not(operand, scope, then)
            case nodes.Relation():
                self.relation(node, scope, then)
            case nodes.InternalAction():
                self._internal_action(node, scope, then)
            case nodes.Structure(functor="true", args=()):
                then(scope)
            case nodes.Structure(functor="false", args=()):
                self.function.emit("pass")
            case nodes.Structure() if not isinstance(node.namespace, nodes.Variable):
                self._query(node, scope, then)
            case _:
                self._dynamic(node, scope, then)

    def _apart(self, node: nodes.Term, scope: Scope, then: Next) -> None:
        """Make the formula a generator that yields the values of the variables it binds."""
        new = [name for name in variables(node) if name not in scope]
        call = self.helper(node, scope, new)
        targets = [self.function.local() for _ in new]
        with self.function.block(f"for {targets_of(targets) if targets else '_'} in {call}:"):
            then({**scope, **dict(zip(new, targets, strict=True))})

    def helper(self, node: nodes.Term, scope: Scope, new: list[str] | None = None) -> str:
        """Return the call of a function of its own for a formula.

        It yields the values of the variables ``new`` for each solution; without a list it returns whether there is one.
        """
        name = self.unit.name("h")
        known = [v for v in variables(node) if v in scope]
        parameters = [f"p{i}" for i in range(len(known))]
        function = Function(self.unit, name, ", ".join(["m", "trail", *parameters]))
        inner = type(self)(self.unit, function, self.library, "")
        inner.rows, inner.nested = None, True

        def succeed(found: Scope) -> None:
            if new is None:
                function.emit("return True")
            else:
                out = [inner.build(nodes.Variable(v), dict(found)) for v in new]
                function.emit(f"yield {tuple_of(out) if out else 'None'}")

        outer = dict(zip(known, parameters, strict=True))
        mark = function.reserve()
        if isinstance(node, nodes.Or):
            for branch in _members(node, nodes.Or):
                inner.formula(branch, dict(outer), succeed)
                function.emit("undo(trail, mark)")
        else:
            inner.formula(node, outer, succeed)
            function.emit("undo(trail, mark)")
        function.fill(mark, "mark = len(trail)")
        function.emit("return False" if new is None else "yield from ()")
        self.unit.add(function)
        return f"{name}({', '.join(['m', 'trail', *(scope[v] for v in known)])})"

    def _not(self, operand: nodes.Term, scope: Scope, then: Next) -> None:
        call = self.helper(operand, scope)
        mark = self.function.assign("len(trail)", "t")
        with self.function.block(f"if not {call}:"):
            then(scope)
        with self.function.block(f"elif len(trail) > {mark}:"):
            self.function.emit(f"undo(trail, {mark})")

    def _query(self, node: nodes.Structure, scope: Scope, then: Next) -> None:
        """Write a literal: a loop over the answers of its predicate."""
        predicate = self.constant(Ref("predicate", signature_of(node)))
        given = [self._given(arg, scope) for arg in node.args]
        patterns = self._patterns(node.args, given, scope)
        arguments = [g or p for g, p in zip(given, patterns, strict=True)]
        given_or_not = tuple(part is not None for part in arguments)
        mode = self.constant(_modes.setdefault(given_or_not, given_or_not))
        rows = [self.function.local("r") for _ in node.args]
        targets = targets_of(rows) if rows else "_"
        annotated = node.annotations is not None and (node.annotations.items or node.annotations.tail)
        if annotated:
            annots = self.function.local("n")
            values = self._asked(given, patterns, scope)
            head = f"for ({targets}), {annots} in {predicate}.literals({mode}, {values}, m, trail):"
        else:
            if any(patterns):
                asked = self.function.local("q")
                with self.function.block(f"if not {predicate}.plain:"):
                    self.function.emit(f"{asked} = {self._asked(given, patterns, scope)}")
            else:
                asked = self._asked(given, patterns, scope)
            solve = f"{predicate}.solve({mode}, {asked}, m, trail)"
            position = next((i for i, g in enumerate(given) if g is not None), None)
            loops = self.function.loops
            inner = bool(loops or self.nested)  # else it is one loop over what is believed, and not counted
            if position is not None:
                rows_of = f"{position}, {given[position]}"
                quick = f"{predicate}.counted_rows({rows_of}, m)" if inner else f"{predicate}.rows({rows_of})"
            else:
                quick = f"reversed({predicate}.entries)"
            if loops > 1 or (inner and position is None):
                self.function.emit(f"m.steps_left -= {f'len({predicate}.entries)' if position is None else 1}")
                self.function.emit("if m.steps_left < 0: too_much_work(m)")
            head = f"for {targets} in ({quick} if {predicate}.plain else {solve}):"

        def found(inner: Scope) -> None:
            if annotated:
                assert node.annotations is not None
                self.match_annots(node.annotations, annots, inner, then)
            else:
                then(inner)

        if self.rows is not None:
            self.rows.append(f"({predicate}, {tuple_of(rows)})")
        with self.function.block(head):
            # Taken for each answer: bindings that a rule has made to find it remain for the next one.
            mark = self.function.assign("len(trail)", "t") if rows or annotated else ""
            self._match_row(list(zip(node.args, given, rows, strict=True)), scope, found)
            if rows or annotated:
                self.function.emit(f"if len(trail) > {mark}: undo(trail, {mark})")

    def _patterns(self, args: tuple[nodes.Term, ...], given: list[str | None], scope: Scope) -> list[nodes.Term | None]:
        """For each argument that is known in part the pattern that a rule is asked with, None for the others.

        A rule may compare, negate or compute what it is asked with, so it has to see all that is known: ``box(5,_)``
        and ``[a|T]`` as much as ``p(X,X)``. A variable that occurs alone is left for the rule to find.
        """
        often = Counter(name for arg in args for name in variables(arg))
        patterns = []
        for arg, known in zip(args, given, strict=True):
            pattern = None if known else self._known_part(arg, scope)
            alone = type(pattern) is nodes.Variable and (pattern.anonymous or often[pattern.name] < 2)
            patterns.append(None if alone else pattern)
        return patterns

    def _known_part(self, node: nodes.Term, scope: Scope, depth: int = 0) -> nodes.Term:
        """Return a term with a variable for each part that is not known before the answer is compared with it."""
        if is_constant(node) or is_plain_variable(node):
            return node
        if depth <= MAX_INDENT:
            match node:
                case nodes.Structure() if self._is_plain_structure(node):
                    return replace(node, args=tuple(self._known_part(a, scope, depth + 1) for a in node.args))
                case nodes.ListTerm(items=items, tail=tail):
                    parts = tuple(self._known_part(i, scope, depth + 1) for i in items)
                    known: Any = tail and self._known_part(tail, scope, depth + 1)
                    return nodes.ListTerm(parts, known)
                case nodes.Arithmetic() if all(name in scope for name in variables(node)):
                    return node
        return nodes.Variable("_")

    def _asked(self, given: list[str | None], patterns: list[nodes.Term | None], scope: Scope) -> str:
        """Return what a rule is asked with: values, patterns with new variables, None for what it is to find."""
        inner = dict(scope)
        parts = zip(given, patterns, strict=True)
        return tuple_of([g or ("None" if p is None else self.build(p, inner)) for g, p in parts])

    def _given(self, arg: nodes.Term, scope: Scope) -> str | None:
        """Return the local with the value of an argument that is known before the query; None for one to be found."""
        if is_plain_variable(arg):
            return scope.get(arg.name)
        if is_constant(arg) or (_can_be_given(arg) and all(name in scope for name in variables(arg))):
            return self.function.assign(self.build(arg, dict(scope)))
        return None

    def _match_row(self, parts: list[tuple[nodes.Term, str | None, str]], scope: Scope, then: Next) -> None:
        if not parts:
            then(scope)
            return
        (arg, given, row), others = parts[0], parts[1:]

        def rest(inner: Scope) -> None:
            self._match_row(others, inner, then)

        if given is None or is_constant(arg):
            self.match(arg, row, scope, rest)
        else:
            self._match_known(given, row, scope, rest)

    def match_annots(self, pattern: nodes.ListTerm, annots: str, scope: Scope, then: Next) -> None:
        """Write that the annotations asked for are among those there; each choice is a solution."""
        if pattern.tail is None and len(pattern.items) == 1:
            one = self.function.local("n")
            mark = self.function.assign("len(trail)", "t")
            with self.function.block(f"for {one} in {annots}:"):
                self.match(pattern.items[0], one, scope, then)
                self.function.emit(f"if len(trail) > {mark}: undo(trail, {mark})")
            return
        inner = dict(scope)
        built = self.pattern_annots(pattern, inner)
        with self.function.block(f"for _ in subsets({built}, {annots}, trail):"):
            then(self.settled(scope, inner))

    def _dynamic(self, node: nodes.Term, scope: Scope, then: Next) -> None:
        """Write a formula that only the run knows: a variable, or a literal in a namespace that is a variable."""
        inner = dict(scope)
        built = self.function.assign(self.build(node, inner))
        with self.function.block(f"for _ in solve(m, {built}, trail):"):
            then(self.settled(scope, inner))

    def _internal_action(self, node: nodes.InternalAction, scope: Scope, then: Next) -> None:
        special = QUERIES.get((node.name, len(node.args)))
        if special is not None and special(self, node, scope, then):
            return
        action = self.library.action(node.name, len(node.args))
        if action is None:
            if not self.library.is_function(node.name, len(node.args)):
                self.library.unknown_action(node)
            self.function.emit("pass")
            return
        inner = dict(scope)
        args = "".join(f", {arg}" for arg in self.action_arguments(node, inner))
        function = self.constant(action.guarded())
        with self.function.block(f"{'for _ in' if action.backtracks else 'if'} {function}(m, trail{args}):"):
            then(self.settled(scope, inner))

    def action_arguments(self, node: nodes.InternalAction, scope: Scope) -> list[str]:
        """Expressions for the arguments; what a plan term in them leaves open is linked to the plan's variables."""
        self.linking = True
        built = [self.build(arg, scope) for arg in node.args]
        self.linking = False
        return built

    def count(self, query: nodes.Term, scope: Scope) -> str:
        """Return an expression for the number of solutions of a query."""
        counter = self.function.assign("0", "c")
        self.each(query, scope, lambda _: self.function.emit(f"{counter} += 1"))
        return self.function.assign(f"float({counter})")

    def each(self, query: nodes.Term, scope: Scope, take: Next) -> None:
        """Write what is done for each solution of a query inside a formula, which binds nothing in that."""
        rows, self.rows = self.rows, None  # no one solution of the formula rests on these facts
        self.formula(query, dict(scope), take)
        self.rows = rows


def conjuncts(node: nodes.Term) -> list[nodes.Term]:
    """Return the members of a conjunction from left to right."""
    return _members(node, nodes.And)


def _members(node: nodes.Term, kind: type[nodes.And] | type[nodes.Or]) -> list[nodes.Term]:
    found: list[nodes.Term] = []
    pending = [node]
    while pending:
        node = pending.pop()
        if isinstance(node, kind):
            pending += (node.right, node.left)
        else:
            found.append(node)
    return found


def _conjunction(parts: list[nodes.Term]) -> nodes.Term:
    node = parts[0]
    for part in parts[1:]:
        node = nodes.And(node, part)
    return node


def _can_be_given(node: nodes.Term, depth: int = 0) -> bool:
    """Return whether a term of known variables may be built before it is compared (no anonymous one in it)."""
    if depth > MAX_INDENT:
        return False
    match node:
        case nodes.Variable():
            return is_plain_variable(node) and not node.anonymous
        case nodes.Structure(args=args, annotations=annots, namespace=namespace):
            return (
                annots is None
                and not isinstance(namespace, nodes.Variable)
                and all(_can_be_given(a, depth + 1) for a in args)
            )
        case nodes.ListTerm(items=items, tail=tail):
            return all(_can_be_given(i, depth + 1) for i in items) and (tail is None or _can_be_given(tail, depth + 1))
        case nodes.Arithmetic(operands=operands):
            return all(_can_be_given(o, depth + 1) for o in operands)
        case nodes.Number() | nodes.String():
            return True
    return False


_modes: dict[tuple[bool, ...], tuple[bool, ...]] = {}
"""One object for each mode in which a predicate is queried."""


Writer = Callable[[FormulaCompiler, nodes.InternalAction, Scope, Next], bool]
"""Writes a call of an internal action with a query, such as ``.findall``, as loops.

Returns False when its arguments are not of the kind: then the internal action itself must decide.
"""

_FORMULAS = (nodes.Structure, nodes.InternalAction, nodes.Relation, nodes.Not, nodes.And, nodes.Or)


def is_query(node: nodes.Term, scope: Scope) -> bool:
    """Return whether an argument is a formula that can be compiled here (or a variable that will hold one)."""
    return isinstance(node, _FORMULAS) or (isinstance(node, nodes.Variable) and node.name in scope)


def _collect(compiler: FormulaCompiler, node: nodes.InternalAction, scope: Scope) -> tuple[str, Scope]:
    """Write the loop that collects the instances of the first argument over the solutions of the second.

    Returns the local with them, and the scope with the variables that only the first argument has: all share those.
    """
    function = compiler.function
    asked = variables(node.args[1])
    scope = dict(scope)
    for name in variables(node.args[0]):
        if name not in asked:
            compiler.build(nodes.Variable(name), scope)
    found = function.assign("[]", "l")
    mark = function.assign("len(trail)", "t")

    def take(inner: Scope) -> None:
        item = function.assign(compiler.build(node.args[0], dict(inner)))
        function.emit(f"{found}.append({item} if type({item}) is float else resolve({item}))")

    compiler.each(node.args[1], scope, take)
    function.emit(f"if len(trail) > {mark}: undo(trail, {mark})")
    return found, scope


def _collected(result: str, needs_one: bool = False) -> Writer:
    """Return the writer of an action whose ``result`` is made of all instances; ``needs_one``: fails for none."""

    def write(compiler: FormulaCompiler, node: nodes.InternalAction, scope: Scope, then: Next) -> bool:
        if not is_query(node.args[1], scope):
            return False
        found, scope = _collect(compiler, node, scope)
        with compiler.function.block(f"if {found}:") if needs_one else nullcontext():
            made = compiler.function.assign(result.format(found))
            compiler.match(node.args[2], made, scope, then)
        return True

    return write


def _count(compiler: FormulaCompiler, node: nodes.InternalAction, scope: Scope, then: Next) -> bool:
    if not is_query(node.args[0], scope):
        return False
    mark = compiler.function.assign("len(trail)", "t")
    result = compiler.count(node.args[0], scope)
    compiler.function.emit(f"if len(trail) > {mark}: undo(trail, {mark})")
    compiler.match(node.args[1], result, scope, then)
    return True


def _eval(compiler: FormulaCompiler, node: nodes.InternalAction, scope: Scope, then: Next) -> bool:
    if not is_query(node.args[1], scope):
        return False
    call = compiler.helper(node.args[1], scope)
    mark = compiler.function.assign("len(trail)", "t")
    result = compiler.function.assign(f"TRUE if {call} else FALSE")
    compiler.function.emit(f"undo(trail, {mark})")
    compiler.match(node.args[0], result, scope, then)
    return True


QUERIES: Final[dict[tuple[str, int], Writer]] = {
    (".findall", 3): _collected("make_list({})"),
    (".setof", 3): _collected("make_list(distinct({}))"),
    (".min", 3): _collected("ordered({})[0]", needs_one=True),
    (".max", 3): _collected("ordered({})[-1]", needs_one=True),
    (".count", 2): _count,
    (".eval", 2): _eval,
}
"""The writers by name and arity."""
