"""The team: creating, cloning and ending agents, the directory of services, files of the agent."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from msgspec.structs import replace

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.printer import source_text
from agentd.language.syntax_tree.signatures import DEFAULT
from agentd.language.terms.format import text
from agentd.language.terms.terms import Code, List, Literal, Term, Var, atom, deref, proper
from agentd.language.terms.to_ast import NoSyntax, ToSyntax
from agentd.mind.beliefs.belief_base import RuleClause
from agentd.mind.beliefs.term_copy import resolve
from agentd.mind.beliefs.unification import Trail, unify
from agentd.mind.beliefs.work_limit import joined
from agentd.mind.data.effects import Log
from agentd.mind.data.formula_failure import Failed, argument, wrong_arguments
from agentd.mind.data.registry import internal_action
from agentd.mind.execution.program_loading import include_program
from agentd.mind.execution.waiting import request
from agentd.mind.plans.plan_library import Plan
from agentd.mind.state import MindState
from agentd.stdlib.messages import name_of
from agentd.stdlib.strings import plain_text


@internal_action(".create_agent", (1, 3), suspends=True)
def create_agent(
    mind: MindState, trail: Trail, name: Term, file: Term | None = None, options: Term | None = None
) -> bool:
    """``.create_agent(Name[, File[, Options]])``: a free name is made up from its own and bound to a string."""
    wanted = deref(name)
    path = "" if file is None else argument(str, file, "the file of a new agent is a string")
    if options is not None:
        if type(deref(options)) is not List:
            wrong_arguments("the options of a new agent are a list")
        _check_options(mind, options)
    if type(wanted) is Var:
        made_up = wanted.name[:1].lower() + wanted.name[1:]
        return request(mind, "create", (made_up, path), wanted)
    return request(mind, "create", (name_of(wanted), path))


_PLAIN_CLASSES: Final = {
    "agentArchClass": ("AgArch", "CentralisedAgArch", "LocalAgArch"),
    "agentClass": ("Agent",),
    "beliefBaseClass": ("DefaultBeliefBase",),
}
"""Options of Jason that name Java classes, and the default classes, which every agent here corresponds to."""


def _check_options(mind: MindState, options: Term) -> None:
    """Fail for an option that names a custom Java class, which cannot be honoured."""
    for option in proper(options) or []:
        term = deref(option)
        name = term.sig.functor if type(term) is Literal else text(term)
        plain = _PLAIN_CLASSES.get(name)
        if plain is None:
            mind.warn_once(f".create_agent: the option {text(term)} is not known and is left out")
            continue
        named = plain_text(term.args[0]).rpartition(".")[2] if term.args else ""
        if named not in plain:
            why = "is a class of Java, which Argosy has not; extend agents in Python (docs/guides/extending.md)"
            raise Failed("unknown", f".create_agent: {text(term)} {why}")


@internal_action(".clone", 1, suspends=True)
def clone(mind: MindState, trail: Trail, name: Term) -> bool:
    """``.clone("name")``: an agent with the same beliefs and plans, without the goals."""
    return request(mind, "clone", (argument(str, name, "the name of a clone is a string"),))


@internal_action(".kill_agent", (1, 2), suspends=True)
def kill_agent(mind: MindState, trail: Trail, name: Term, delay: Term = 0.0) -> bool:
    """``.kill_agent(Name[, Ms])``: ends an agent, immediately or after a delay in ms."""
    pause = argument(float, delay, "the delay of .kill_agent is a number of milliseconds")
    return request(mind, "kill", (name_of(name), pause / 1000.0))


def _with_directory(name: str, calls: str) -> None:
    """Register an action whose request to the directory is about one service."""

    @internal_action(f".{name}", (1, 2), suspends=True)
    def ask(mind: MindState, trail: Trail, service: Term, kind: Term | None = None) -> bool:
        return request(mind, name, (plain_text(service),))

    ask.__doc__ = calls


_with_directory(
    "df_register",
    "``.df_register(Service[, Type])``: this agent offers a service, until it deregisters or ends.",
)
_with_directory("df_deregister", "``.df_deregister(Service[, Type])``: withdraws the service.")
_with_directory(
    "df_subscribe",
    "``.df_subscribe(Service)``: beliefs ``provider(Agent, S)`` for present and future providers, S the service as a "
    "string.",
)


@internal_action(".df_search", (2, 3), suspends=True)
def df_search(mind: MindState, trail: Trail, service: Term, *rest: Term) -> bool:
    """``.df_search(Service[, Type], List)``: the names of the agents that offer it."""
    return request(mind, "df_search", (plain_text(service),), rest[-1])


@internal_action(".list_files", (2, 3), suspends=True)
def list_files(mind: MindState, trail: Trail, folder: Term, *rest: Term) -> bool:
    """``.list_files(Folder[, Regex], List)``: the files below a folder whose path or name matches, as strings.

    ``[]`` if the folder is missing.
    """
    needed = ".list_files takes the folder and the regular expression as strings"
    where, form = argument(str, folder, needed), argument(str, rest[0], needed) if len(rest) == 2 else ".*"
    return request(mind, "list_files", (where, form), rest[-1])


@internal_action(".save_agent", (1, 2), suspends=True)
def save_agent(mind: MindState, trail: Trail, file: Term, goals: Any = None) -> bool:
    """``.save_agent(File[, Goals])``: beliefs, rules, these goals and the plans as source text."""
    path = argument(str, file, "the file to save to is a string")
    return request(mind, "save", (path, program_text(mind, proper(goals) or [] if goals is not None else [])))


@internal_action(".include", (1, 2), suspends=True)
def include(mind: MindState, trail: Trail, file: Term, namespace: Term | None = None) -> bool:
    """``.include(File[, Namespace])``: adds the beliefs, goals and plans of a file."""
    path = argument(str, file, "the file to include is a string")
    into = DEFAULT if namespace is None else _namespace(mind, trail, namespace)
    return request(mind, "include", (path, into), use=lambda program: include_program(mind, program, into))


def _namespace(mind: MindState, trail: Trail, term: Term) -> str:
    """The namespace that a file is included into; for a free variable a new one, which it is bound to."""
    named = deref(term)
    if type(named) is Literal and not named.args:
        return named.sig.functor
    if type(named) is not Var:
        wrong_arguments("the namespace to include into is an atom or a free variable")
    known = {predicate.sig.namespace for predicate in mind.beliefs.predicates()} | set(mind.namespaces)
    number = 1
    while f"ns_{number}" in known:
        number += 1
    mind.namespaces[f"ns_{number}"] = {}
    unify(named, atom(f"ns_{number}"), trail)
    return f"ns_{number}"


# --- program text for ``.save_agent``, which reads back the same ---


DEEPEST: Final = 1000
"""Terms nested deeper are left out of the text."""


def program_text(mind: MindState, goals: list[Any]) -> str:
    """The program as text, with these initial goals. Parts without syntax are left out and logged."""
    return joined(".save_agent", (_line(mind, what, kind) for what, kind in _parts(mind, goals)))


def _parts(mind: MindState, goals: list[Any]) -> Iterator[tuple[Any, type[nodes.Belief | nodes.Goal]]]:
    for predicate in reversed(mind.beliefs.predicates()):  # initial beliefs are added from the last to the first
        for entry in reversed(predicate.entries.values()):
            is_rule = type(entry) is RuleClause
            yield (Code(entry.syntax, entry.values, bare=True) if is_rule else entry), nodes.Belief
    for goal in goals:
        yield deref(resolve(goal)), nodes.Goal
    for plan in mind.plans:
        yield plan, nodes.Belief


def _line(mind: MindState, what: Any, kind: type[nodes.Belief | nodes.Goal]) -> str:
    """The line of a part of the program; empty for one without syntax."""
    try:
        return f"{source_text(_item(what, kind))}\n"
    except NoSyntax as why:
        shown = what.head if type(what) is Plan else text(what)
        mind.effects.append(Log("warning", f".save_agent leaves out {shown}: {why}"))
        return ""


def _item(what: Any, kind: type[nodes.Belief | nodes.Goal]) -> nodes.Item:
    """The syntax of a plan with its label, generated ones too, of a rule, or of a literal as belief or goal."""
    to = ToSyntax(DEEPEST)
    item: nodes.Item
    if type(what) is Plan:
        item = replace(to.code(what.syntax, what.values), label=to.term(what.label))
    elif type(what) is Code and kind is nodes.Belief:
        item = to.code(what.syntax, what.values)
    elif type(what) is Literal:
        item = kind(to.term(what))
    else:
        raise NoSyntax("it is no goal")
    return item
