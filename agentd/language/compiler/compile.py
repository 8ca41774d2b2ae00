"""From parsed files to a program that minds can load: directives are carried out, namespaces put in."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import count
from pathlib import PurePosixPath
from types import MappingProxyType
from typing import Any, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from agentd.language.compiler.plan_patterns import PATTERNS, WrongPattern
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import DEFAULT, THIS_NS
from agentd.language.syntax_tree.traversal import parts, with_parts
from schemas.files.text_files import MAY_PASS

Load = Callable[[str], nodes.Program]
"""Reads and parses an included file, given its path as `Find` has found it."""

Find = Callable[[str, str], str]
"""The path of an included file, given the path in the directive and the directive's file. Raises OSError."""


class CompiledProgram(Struct, frozen=True):
    """What a mind starts from: plain lists in file order. Python is generated from it when a plan is first used."""

    file: str
    beliefs: tuple[nodes.Belief | nodes.Rule, ...] = ()
    goals: tuple[nodes.Goal, ...] = ()
    plans: tuple[nodes.Plan, ...] = ()
    functions: tuple[tuple[str, int, str], ...] = ()
    """Functions that the program registers: name, number of arguments, and the rule that computes it."""
    warnings: tuple[str, ...] = ()
    namespaced: bool = False
    """Whether other namespaces than the default one may occur in it."""


class DirectiveError(ValueError):
    """A directive that cannot be carried out. ``name`` is that of one that does not exist or has wrong arguments."""

    def __init__(self, position: nodes.Position, message: str, name: str = "") -> None:
        super().__init__(f"{position}: error: {message}")
        self.position, self.message, self.name = position, message, name


def beside(path: str, file: str) -> str:
    """`Find` for files in the folder of the one that includes them."""
    return path if PurePosixPath(path).is_absolute() else str(PurePosixPath(file).parent / path)


def compile_program(
    program: nodes.Program, load: Load | None = None, find: Find = beside, namespace: str = DEFAULT
) -> CompiledProgram:
    """Carry out the directives of a parsed program, which is loaded into a namespace.

    ``load`` reads included files; without it they are refused. Raises `DirectiveError` for an unknown or wrong
    directive, and what ``load`` raises.
    """
    expansion = _Expansion(load, find)
    try:
        expansion.file(program, namespace)
    except RecursionError:
        start = nodes.Position(program.file, 1, 1)
        raise DirectiveError(start, "a formula of this program is nested too deep") from None
    return CompiledProgram(
        program.file,
        tuple(expansion.beliefs),
        tuple(expansion.goals),
        tuple(expansion.plans),
        tuple(expansion.functions),
        tuple(expansion.warnings),
        expansion.namespaced,
    )


_MOST_INCLUDES = 200

_NO_RETRY = "a plan of bdg that fails is not tried again: Jason's retry finds the goal intended already; ebdg goes on"

USAGE = {
    "include": 'include needs a file, and maybe a namespace: { include("file.asl", n) }',
    "register_function": "register_function needs a name, a number of arguments and a rule: "
    '{ register_function("f", 2, "r") }',
    "namespace": "namespace needs a name: { begin namespace(n) } ... { end }",
}
"""The directives that enclose nothing, and how each is written."""
_BLOCKS = frozenset(("namespace", *PATTERNS))


def mistake_in(directive: nodes.Directive) -> str:
    """Return why a directive cannot be carried out: it does not exist, or its arguments are wrong; empty if it can."""
    name, block = directive.name.functor, directive.items is not None
    if name not in (_BLOCKS if block else USAGE):
        from agentd.language.syntax_tree.errors import near  # a program without errors starts without these two
        from agentd.language.syntax_tree.printer import source_text

        if block:
            return f"there is no directive {{ begin {name} }} ... {{ end }}{near(name, _BLOCKS)}"
        if name in PATTERNS:
            return f"the directive {name} encloses its plans: {{ begin {source_text(directive.name)} }} ... {{ end }}"
        return f"there is no directive {{ {name} }}{near(name, USAGE)}"
    if name in PATTERNS:
        try:
            PATTERNS[name](directive.position, directive.name.args, directive.items or ())
        except WrongPattern as wrong:
            return f"the pattern {name} {wrong}"
        return ""
    match name, directive.name.args:
        case "include", (nodes.String(path),) | (nodes.String(path), nodes.Structure()) if "\0" not in path:
            return ""
        case "register_function", (nodes.String(), nodes.Number(), nodes.String()):
            return ""
        case "namespace", (nodes.Structure(), *_):
            return ""
    return USAGE[name]


class _Expansion:
    """Collects the items of a program and of the files it includes."""

    def __init__(self, load: Load | None, find: Find) -> None:
        self._load, self._find = load, find
        self.beliefs: list[nodes.Belief | nodes.Rule] = []
        self.goals: list[nodes.Goal] = []
        self.plans: list[nodes.Plan] = []
        self.functions: list[tuple[str, int, str]] = []
        self.warnings: list[str] = []
        self.namespaced = False
        self._includes = 0
        self._local = count(1)

    def file(self, program: nodes.Program, namespace: str) -> None:
        """Add the items of a file and of those that it includes."""
        self.warnings.extend(str(w) for w in program.warnings)
        self.namespaced |= program.scoped or namespace != DEFAULT
        local = local_names(program.items, self._local)
        self._items(program.items, Qualifier(namespace, namespace, local, program.this_ns))

    def _items(self, items: tuple[nodes.Item, ...], qualifier: Qualifier) -> None:
        for item in items:
            match item:
                case nodes.Belief() | nodes.Rule():
                    self.beliefs.append(qualifier.item(item))
                case nodes.Goal():
                    self.goals.append(qualifier.item(item))
                case nodes.Plan():
                    self.plans.append(qualifier.item(item))
                case nodes.Directive():
                    if mistake := mistake_in(item):
                        raise DirectiveError(item.position, mistake, item.name.functor)
                    self._directive(item, qualifier)

    def _directive(self, directive: nodes.Directive, qualifier: Qualifier) -> None:
        """Carry out a directive without a mistake."""
        items = directive.items
        match directive.name.functor, directive.name.args:
            case "include", (nodes.String(path),):
                self._include(directive, path, qualifier.current)
            case "include", (nodes.String(path), nodes.Structure(into)):
                self._include(directive, path, into)
            case "register_function", (nodes.String(name), nodes.Number(arity), nodes.String(rule)):
                self.functions.append((name, int(arity), rule))
            case "namespace", (nodes.Structure(name), *_) if items is not None:
                self.namespaced = True
                self._items(items, qualifier.inside(name))
            case "namespace", (_, nodes.Structure("local" | "global")):
                pass  # declares the kind of a namespace; read by `local_names`
            case "namespace", _:
                self.warnings.append(f"{directive.position}: warning: a namespace without block has no effect")
            case pattern, args:
                if pattern == "bdg":
                    self.warnings.append(f"{directive.position}: warning: {_NO_RETRY}")
                self._items(PATTERNS[pattern](directive.position, args, items or ()), qualifier)

    def _include(self, directive: nodes.Directive, path: str, namespace: str) -> None:
        self._includes += 1
        if self._load is None or self._includes > _MOST_INCLUDES:
            why = "no files can be read here" if self._load is None else "files include one another without end"
            raise DirectiveError(directive.position, f'cannot include "{path}": {why}')
        try:
            included = self._load(self._find(path, directive.position.file))
        except OSError as error:
            if error.errno in MAY_PASS:
                raise
            message = f'cannot include "{path}": {error.strerror or error}'
            raise DirectiveError(directive.position, message) from error
        self.file(included, namespace)


_QUERIES = {
    **dict.fromkeys((".findall", ".setof", ".eval"), 1),
    **dict.fromkeys((".count", ".abolish", ".belief", ".asserta", ".assertz", ".wait", ".foreach", ".loop"), 0),
    **dict.fromkeys(
        (".desire", ".intend", ".drop_desire", ".drop_intention", ".drop_event", ".drop_future_intention"), 0
    ),
    **dict.fromkeys((".succeed_goal", ".fail_goal", ".suspend", ".resume", ".suspended"), 0),
}
"""Internal actions whose argument at this place is a formula or a goal, which belongs to the namespace as well."""


_Item = TypeVar("_Item", nodes.Belief, nodes.Rule, nodes.Goal, nodes.Plan, nodes.Belief | nodes.Rule)
_Literal = TypeVar("_Literal", nodes.Structure, nodes.Variable, nodes.Structure | nodes.Variable)


class Qualifier:
    """Qualifies beliefs, goals, triggers, formulas and code in braces, but not the arguments inside them.

    ``current`` is the namespace of the block, ``default`` what ``::p`` means in it. ``local`` gives the names by which
    the mind knows the local namespaces of the file: no other file can name them (rule 103). ``this_ns`` says that the
    file may call the current namespace so, as an atom and before ``::``.
    """

    def __init__(self, current: str, default: str, local: dict[str, str], this_ns: bool = False) -> None:
        self.current, self.default, self.local, self.this_ns = current, default, local, this_ns

    def inside(self, namespace: str) -> Qualifier:
        """Return the qualifier of a block of this file."""
        return Qualifier(self.local.get(namespace, namespace), self.default, self.local, self.this_ns)

    def item(self, item: _Item) -> _Item:
        """Return a belief, rule, goal or plan with its namespace put in."""
        if self.local or self.this_ns:
            item = _renamed(item, self.local, {THIS_NS: self.current})
        if self.this_ns:  # before an argument it means nothing, as in Jason
            bare: _Item = _renamed(self._qualified(item), {THIS_NS: None})
            return bare
        if self.current == DEFAULT and self.default == DEFAULT:
            return item
        return self._qualified(item)

    def _qualified(self, item: _Item) -> _Item:
        match item:
            case nodes.Belief(literal=literal, position=position):
                qualified: Any = nodes.Belief(self.literal(literal), position)
                return qualified  # type: ignore[no-any-return]
            case nodes.Rule(head=head, body=body):
                return replace(item, head=self.literal(head), body=self.formula(body))
            case nodes.Goal(literal=literal):
                return replace(item, literal=self.literal(literal))
            case nodes.Plan():
                plan: Any = self._inside(item)
                return plan  # type: ignore[no-any-return]
        return item

    def _inside(self, node: Any) -> Any:
        """Return a plan, trigger, body or statement with what is in it qualified; any other part is a formula."""
        match node:
            case tuple():
                return tuple(map(self._inside, node))
            case nodes.Trigger(literal=literal):
                return replace(node, literal=self.literal(literal))
            case nodes.Step():
                return self._step(node)
            case nodes.Plan() | nodes.Body() | nodes.If() | nodes.While() | nodes.For() | nodes.Fork():
                names = [name for name in node.__struct_fields__ if name not in ("position", "label")]
                return replace(node, **{name: self._inside(getattr(node, name)) for name in names})
            case nodes.Node():
                return self.formula(node)
        return node

    def literal(self, literal: _Literal) -> _Literal:
        """Return a literal or variable of the block."""
        namespace = literal.namespace
        if namespace is None or namespace == THIS_NS:
            return replace(literal, namespace=self.current)
        return replace(literal, namespace=self.default) if namespace == "" else literal

    def formula(self, node: Any) -> Any:
        """Return a formula of the block."""
        match node:
            case nodes.Structure(functor="true" | "false", args=()):
                return node
            case nodes.Structure():
                return self.literal(node)
            case nodes.And() | nodes.Or() | nodes.Not():
                return with_parts(node, tuple(map(self.formula, parts(node) or ())))
            case nodes.InternalAction(name=name, args=args):
                place = _QUERIES.get(name, -1)
                return replace(
                    node, args=tuple(self.formula(a) if i == place else self.code(a) for i, a in enumerate(args))
                )
            case nodes.Relation(left=left, right=right):
                return replace(node, left=self._side(left), right=self._side(right))
        return self.code(node)

    def _side(self, node: Any) -> Any:
        """Return a side of a relation; the current namespace before a variable means nothing there, as in Jason."""
        if isinstance(node, nodes.Variable) and node.namespace in (self.current, THIS_NS):
            return replace(node, namespace=None)
        return self.code(node)

    def code(self, node: Any) -> Any:
        """Code in braces, which always belongs to the block; any other term unchanged."""
        match node:
            case nodes.PlanTerm(plan=plan):
                return replace(node, plan=self._inside(plan))
            case nodes.TriggerTerm(trigger=trigger):
                return replace(node, trigger=self._inside(trigger))
            case nodes.BodyTerm(body=body):
                return replace(node, body=self._inside(body))
            case nodes.RuleTerm(rule=rule):
                return replace(node, rule=self._qualified(rule))
        return node

    def _step(self, step: nodes.Step) -> nodes.Step:
        match step:
            case nodes.Step(operator=nodes.Operator.ACTION, term=nodes.Structure()):
                return step
            case nodes.Step(operator=nodes.Operator.ACTION | nodes.Operator.TEST, term=term):
                return replace(step, term=self.formula(term))
            case nodes.Step(term=nodes.Structure() as literal):
                return replace(step, term=self.literal(literal))
        return replace(step, term=self.code(step.term))


def local_names(items: Iterable[nodes.Item], number: Iterator[int]) -> dict[str, str]:
    """Return the local namespaces that a file declares, with names from ``number`` on that no other file has."""
    found: dict[str, str] = {}
    pending = list(items)
    while pending:
        item = pending.pop()
        if not isinstance(item, nodes.Directive):
            continue
        pending.extend(item.items or ())
        match item.name:
            case nodes.Structure(
                functor="namespace", args=(nodes.Structure(functor=name), nodes.Structure(functor="local"))
            ):
                if name not in found:
                    found[name] = f"{name}#{next(number)}"
    return found


def _renamed(node: Any, prefixes: Mapping[str, str | None], atoms: Mapping[str, str] = MappingProxyType({})) -> Any:
    """Return a node with other names for some namespaces before ``::``, and other atoms for some."""
    if isinstance(node, tuple):
        return tuple(_renamed(part, prefixes, atoms) for part in node)
    if isinstance(node, nodes.Belief):
        return nodes.Belief(_renamed(node.literal, prefixes, atoms), node.position)
    if not isinstance(node, nodes.Node):
        return node
    changes: dict[str, Any] = {}
    if isinstance(node, nodes.Structure) and node.functor in atoms and not node.args:
        changes["functor"] = atoms[node.functor]
    for name in node.__struct_fields__:
        part = getattr(node, name)
        if name == "namespace" and isinstance(part, str):
            changed: Any = prefixes.get(part, part)
        else:
            changed = _renamed(part, prefixes, atoms)
        if changed is not part:
            changes[name] = changed
    return replace(node, **changes) if changes else node
