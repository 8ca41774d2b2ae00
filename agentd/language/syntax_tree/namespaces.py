"""Puts the namespace of a file or block into the literals that belong to it (rules 99 to 103)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from types import MappingProxyType
from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import DEFAULT, THIS_NS

_QUERIES = {
    **dict.fromkeys((".findall", ".setof", ".eval"), 1),
    **dict.fromkeys((".count", ".abolish", ".belief", ".asserta", ".assertz", ".wait", ".foreach", ".loop"), 0),
    **dict.fromkeys(
        (".desire", ".intend", ".drop_desire", ".drop_intention", ".drop_event", ".drop_future_intention"), 0
    ),
    **dict.fromkeys((".succeed_goal", ".fail_goal", ".suspend", ".resume", ".suspended"), 0),
}
"""Internal actions whose argument at this place is a formula or a goal, which belongs to the namespace as well."""


class Qualifier:
    """Qualifies beliefs, goals, triggers, formulas and code in braces, but not the arguments inside them.

    ``current`` is the namespace of the block, ``default`` what ``::p`` means in it. ``local`` gives the names by which
    the mind knows the local namespaces of the file: no other file can name them (rule 103). ``this_ns`` says that the
    file may call the current namespace so, as an atom and before ``::``.
    """

    def __init__(self, current: str, default: str, local: dict[str, str], this_ns: bool = False) -> None:
        self.current, self.default, self.local, self.this_ns = current, default, local, this_ns

    def inside(self, namespace: str) -> Qualifier:
        """The qualifier of a block of this file."""
        return Qualifier(self.local.get(namespace, namespace), self.default, self.local, self.this_ns)

    def item(self, item: Any) -> Any:
        """A belief, rule, goal or plan with its namespace put in."""
        if self.local or self.this_ns:
            item = _renamed(item, self.local, {THIS_NS: self.current})
        if self.this_ns:  # before an argument it means nothing, as in Jason
            return _renamed(self._qualified(item), {THIS_NS: None})
        if self.current == DEFAULT and self.default == DEFAULT:
            return item
        return self._qualified(item)

    def _qualified(self, item: Any) -> Any:
        match item:
            case nodes.Belief(literal=literal):
                return replace(item, literal=self.literal(literal))
            case nodes.Rule(head=head, body=body):
                return replace(item, head=self.literal(head), body=self.formula(body))
            case nodes.Goal(literal=literal):
                return replace(item, literal=self.literal(literal))
            case nodes.Plan():
                return self.plan(item)
        return item

    def plan(self, plan: nodes.Plan) -> nodes.Plan:
        return replace(
            plan,
            trigger=replace(plan.trigger, literal=self.literal(plan.trigger.literal)),
            context=None if plan.context is None else self.formula(plan.context),
            goal_condition=None if plan.goal_condition is None else self.formula(plan.goal_condition),
            body=self.body(plan.body),
            subplans=tuple(self.plan(p) for p in plan.subplans),
        )

    def literal(self, literal: Any) -> Any:
        """A literal or variable of the block."""
        namespace = literal.namespace
        if namespace is None or namespace == THIS_NS:
            return replace(literal, namespace=self.current)
        return replace(literal, namespace=self.default) if namespace == "" else literal

    def formula(self, node: Any) -> Any:
        match node:
            case nodes.Structure(functor="true" | "false", args=()):
                return node
            case nodes.Structure():
                return self.literal(node)
            case nodes.And(left=left, right=right) | nodes.Or(left=left, right=right):
                return replace(node, left=self.formula(left), right=self.formula(right))
            case nodes.Not(operand=operand):
                return replace(node, operand=self.formula(operand))
            case nodes.InternalAction(name=name, args=args):
                place = _QUERIES.get(name, -1)
                return replace(
                    node, args=tuple(self.formula(a) if i == place else self.code(a) for i, a in enumerate(args))
                )
            case nodes.Relation(left=left, right=right):
                return replace(node, left=self._side(left), right=self._side(right))
        return self.code(node)

    def _side(self, node: Any) -> Any:
        """A side of a relation; the current namespace before a variable means nothing there, as in Jason."""
        if isinstance(node, nodes.Variable) and node.namespace in (self.current, THIS_NS):
            return replace(node, namespace=None)
        return self.code(node)

    def code(self, node: Any) -> Any:
        """Code in braces, which belongs to the block wherever it stands; any other term as it is."""
        match node:
            case nodes.PlanTerm(plan=plan):
                return replace(node, plan=self.plan(plan))
            case nodes.TriggerTerm(trigger=trigger):
                return replace(node, trigger=replace(trigger, literal=self.literal(trigger.literal)))
            case nodes.BodyTerm(body=body):
                return replace(node, body=self.body(body))
            case nodes.RuleTerm(rule=rule):
                return replace(node, rule=self._qualified(rule))
        return node

    def body(self, body: nodes.Body) -> nodes.Body:
        return replace(body, formulas=tuple(self.body_formula(f) for f in body.formulas))

    def body_formula(self, node: Any) -> Any:
        match node:
            case nodes.Step(operator=nodes.Operator.ACTION, term=nodes.Structure()):
                return node
            case nodes.Step(operator=nodes.Operator.ACTION | nodes.Operator.TEST, term=term):
                return replace(node, term=self.formula(term))
            case nodes.Step(term=nodes.Structure() as literal):
                return replace(node, term=self.literal(literal))
            case nodes.Step(term=term):
                return replace(node, term=self.code(term))
            case nodes.If(branches=branches, otherwise=otherwise):
                return replace(
                    node,
                    branches=tuple((self.formula(c), self.body(b)) for c, b in branches),
                    otherwise=None if otherwise is None else self.body(otherwise),
                )
            case nodes.While(condition=condition, body=body) | nodes.For(condition=condition, body=body):
                return replace(node, condition=self.formula(condition), body=self.body(body))
            case nodes.Fork(branches=branches):
                return replace(node, branches=tuple(self.body(b) for b in branches))
        return node


def local_names(items: Iterable[nodes.Item], number: Iterator[int]) -> dict[str, str]:
    """The local namespaces that a file declares, each with a name that no other file has for it."""
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
    """A node with other names for some namespaces before ``::``, and other atoms for some."""
    if isinstance(node, tuple):
        return tuple(_renamed(part, prefixes, atoms) for part in node)
    if not is_dataclass(node) or isinstance(node, nodes.Position | type):
        return node
    changes: dict[str, Any] = {}
    if isinstance(node, nodes.Structure) and node.functor in atoms and not node.args:
        changes["functor"] = atoms[node.functor]
    for field in fields(node):
        part = getattr(node, field.name)
        if field.name == "namespace" and isinstance(part, str):
            changed: Any = prefixes.get(part, part)
        else:
            changed = _renamed(part, prefixes, atoms)
        if changed is not part:
            changes[field.name] = changed
    return replace(node, **changes) if changes else node
