"""From parsed files to a program that minds can load: directives are carried out, namespaces put in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from pathlib import PurePosixPath

from agentd.language.compiler.plan_patterns import PATTERNS, WrongPattern
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.namespaces import Qualifier, local_names
from agentd.language.syntax_tree.signatures import DEFAULT

Load = Callable[[str], nodes.Program]
"""Reads and parses an included file, given its path as `Find` has found it."""

Find = Callable[[str, str], str]
"""The path of an included file, given what the directive says and the file that it stands in. Raises OSError."""


@dataclass(frozen=True, slots=True)
class CompiledProgram:
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
    """A directive that cannot be carried out; ``position`` says where it stands."""

    def __init__(self, position: nodes.Position, message: str) -> None:
        super().__init__(f"{position}: error: {message}")
        self.position, self.message = position, message


def beside(path: str, file: str) -> str:
    """`Find` for files that stand beside the one that includes them."""
    return path if PurePosixPath(path).is_absolute() else str(PurePosixPath(file).parent / path)


def compile_program(program: nodes.Program, load: Load | None = None, find: Find = beside) -> CompiledProgram:
    """Carry out the directives of a parsed program. ``load`` reads included files; without it they are refused.

    Raises `DirectiveError` for an unknown or wrong directive, and what ``load`` raises.
    """
    return in_namespace(program, DEFAULT, load, find)


def in_namespace(
    program: nodes.Program, namespace: str, load: Load | None = None, find: Find = beside
) -> CompiledProgram:
    """`compile_program` of a file that is loaded into a namespace."""
    try:
        return _expanded(program, namespace, load, find)
    except RecursionError:
        start = nodes.Position(program.file, 1, 1)
        raise DirectiveError(start, "a formula of this program is nested too deep") from None


def _expanded(program: nodes.Program, namespace: str, load: Load | None, find: Find) -> CompiledProgram:
    expansion = _Expansion(load, find)
    expansion.file(program, namespace)
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

# What to say when the arguments of a directive are not what it needs.
_ALONE = {
    "include": 'include needs a file, and maybe a namespace: { include("file.asl", n) }',
    "register_function": "register_function needs a name, a number of arguments and a rule: "
    '{ register_function("f", 2, "r") }',
    "namespace": "namespace needs a name: { begin namespace(n) } ... { end }",
}
DIRECTIVES = tuple(_ALONE)
"""The directives that enclose nothing."""
_BLOCKS = {"namespace": _ALONE["namespace"]}


def _wrong(name: str, known: dict[str, str]) -> str:
    if name in known:
        return known[name]
    if known is _ALONE and name in PATTERNS:
        return f"the pattern {name} encloses its plans: {{ begin {name}(...) }} ... {{ end }}"
    from agentd.language.errors.suggestions import near  # a program without errors starts without what compares words

    return f"unknown directive '{name}'{near(name, [*known, *PATTERNS])}"


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
                case nodes.Directive(items=None):
                    self._directive(item, qualifier)
                case nodes.Directive():
                    self._block(item, qualifier)

    def _directive(self, directive: nodes.Directive, qualifier: Qualifier) -> None:
        match directive.name:
            case nodes.Structure(functor="include", args=(nodes.String(value=path),)):
                self._include(directive, path, qualifier.current)
            case nodes.Structure(functor="include", args=(nodes.String(value=path), nodes.Structure(functor=ns))):
                self._include(directive, path, ns)
            case nodes.Structure(
                functor="register_function",
                args=(nodes.String(value=name), nodes.Number(value=arity), nodes.String(value=rule)),
            ):
                self.functions.append((name, int(arity), rule))
            case nodes.Structure(functor="namespace", args=(_, nodes.Structure(functor="local" | "global"))):
                pass  # says of what kind a namespace is before it is used; `local_names` has seen it
            case nodes.Structure(functor="namespace", args=(nodes.Structure(), *_)):
                self.warnings.append(f"{directive.position}: warning: a namespace without block has no effect")
            case nodes.Structure(functor=name):
                raise DirectiveError(directive.position, _wrong(name, _ALONE))

    def _include(self, directive: nodes.Directive, path: str, namespace: str) -> None:
        self._includes += 1
        if self._load is None or self._includes > _MOST_INCLUDES:
            why = "no files can be read here" if self._load is None else "files include one another without end"
            raise DirectiveError(directive.position, f'cannot include "{path}": {why}')
        try:
            included = self._load(self._find(path, directive.position.file))
        except OSError as error:
            message = f'cannot include "{path}": {error.strerror or error}'
            raise DirectiveError(directive.position, message) from error
        self.file(included, namespace)

    def _block(self, directive: nodes.Directive, qualifier: Qualifier) -> None:
        assert directive.items is not None
        match directive.name:
            case nodes.Structure(functor="namespace", args=(nodes.Structure(functor=name), *_)):
                self.namespaced = True
                self._items(directive.items, qualifier.inside(name))
            case nodes.Structure(functor=name, args=args) if name in PATTERNS:
                try:
                    items = PATTERNS[name](directive.position, args, directive.items)
                except WrongPattern as wrong:
                    raise DirectiveError(directive.position, f"the pattern {name} {wrong}") from wrong
                if name == "bdg":
                    self.warnings.append(f"{directive.position}: warning: {_NO_RETRY}")
                self._items(items, qualifier)
            case nodes.Structure(functor=name):
                raise DirectiveError(directive.position, _wrong(name, _BLOCKS))
