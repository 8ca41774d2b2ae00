"""The walk through a program that finds what it mentions. One walk, no recursion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import NamedTuple, TypeAlias

from agentd.check.symbol_table import ANY_ARITY, Call, Mention, PlacedPlan, Survey, asks_others, qualified
from agentd.language.compiler.compile import USAGE
from agentd.language.compiler.plan_patterns import PATTERNS, WrongPattern
from agentd.language.parser.fact_runs import GroundFact
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.nodes import Operator
from agentd.language.syntax_tree.signatures import DEFAULT, Signature

_QUERIES = {
    ".findall": 1,
    ".setof": 1,
    ".count": 0,
    ".eval": 1,
    ".wait": 0,
    ".belief": 0,
    ".foreach": 0,
    ".loop": 0,
    ".if_then_else": 0,
}
"""The internal actions with a logical formula among their arguments, and which argument it is."""

_RUNNERS = frozenset((".foreach", ".loop", ".if_then_else", ".fork", ".add_plan", ".send", ".broadcast"))
"""The internal actions that run, keep or send the code in their arguments."""

_ASSERTIONS = frozenset((".asserta", ".assertz"))
_FILE_READERS = frozenset((".include", ".create_agent"))
"""The internal actions that read a program while an agent runs."""

_ADDITIONS = frozenset((Operator.ADD, Operator.ADD_NEW_FOCUS, Operator.ADD_FIRST, Operator.ADD_LAST, Operator.UPDATE))
_GOALS = frozenset((Operator.ACHIEVE, Operator.ACHIEVE_NEW_FOCUS))

_LOOKERS = frozenset((".plan_label", ".relevant_plan", ".relevant_plans", ".list_plans", ".remove_plan"))
"""Internal actions that take plans for data, or remove them."""
_ENDERS = frozenset(
    (".drop_all_desires", ".drop_all_intentions", ".drop_desire", ".drop_intention", ".drop_future_intention")
) | frozenset((".add_plan", ".fail_goal", ".succeed_goal", ".suspend", ".stopMAS", ".kill_agent"))
"""Internal actions that may end, suspend or change what another intention does."""

Includes: TypeAlias = Callable[[nodes.Directive | nodes.InternalAction, str], Iterable[nodes.Item]]


class _Visit(NamedTuple):
    """Something still to be looked at. ``data``: code that is only held as a term, and not known to run."""

    node: nodes.Term | nodes.Body | nodes.Plan
    namespace: str
    formula: bool = False
    inverted: bool = False
    data: bool = True


def survey(items: Iterable[nodes.Item], includes: Includes | None = None) -> Survey:
    """Survey the items of a program; ``includes`` gives the items of a file included into a namespace."""
    return _Walk(includes or (lambda what, namespace: ())).over(items)


class _Walk:
    def __init__(self, includes: Includes) -> None:
        self._includes = includes
        self.found = Survey()
        self._pending: list[_Visit] = []
        self._top: dict[str, list[PlacedPlan]] = {}
        self._facts: set[tuple[str, Signature]] = set()
        self._files: list[nodes.InternalAction] = []
        self._saved: set[str] = set()
        self._saves_any = False

    def over(self, items: Iterable[nodes.Item]) -> Survey:
        """Survey the items of a program; return this survey."""
        self._read(items, DEFAULT)
        while self._pending or self._files:
            if self._pending:
                self._visit(self._pending.pop())
            else:  # all else first: files that the program itself saves need not be there yet
                self._file(self._files.pop())
        self.found.families += self._top.values()
        return self.found

    def _read(self, items: Iterable[nodes.Item], namespace: str) -> None:
        """Take in the items of a file; their contents are left to be visited."""
        blocks: list[tuple[Iterator[nodes.Item], str]] = [(iter(items), namespace)]
        while blocks:
            block, namespace = blocks[-1]
            item = next(block, None)
            if item is None:
                blocks.pop()
            elif isinstance(item, nodes.Directive):
                inside, namespace = self._directive(item, namespace)
                blocks.append((iter(inside), namespace))
            elif isinstance(item, nodes.Plan):
                self._top.setdefault(namespace, []).append(self._place(item, namespace))
                self._pending.append(_Visit(item, namespace))
            else:
                self._fact(item, namespace)

    def _directive(self, item: nodes.Directive, namespace: str) -> tuple[Iterable[nodes.Item], str]:
        """Return the items that a directive encloses or includes, and their namespace."""
        self.found.directives.append(item)
        match item.name.functor, item.name.args:
            case "namespace", (nodes.Structure(functor), *_):
                return item.items or (), functor
            case "include", (_, nodes.Structure(functor), *_):
                return self._includes(item, functor), functor
            case "include", _:
                return self._includes(item, namespace), namespace
            case "register_function", (nodes.String(function), nodes.Number(arity), *_):
                self.found.functions.add((function, int(arity)))
            case "register_function", (nodes.String(function), *_):
                self.found.functions.add((function, ANY_ARITY))
            case name, args if name in PATTERNS:
                self._pattern(name, args, item, namespace)
            case _, args:
                for term in args:
                    self._term(term, namespace)
        return item.items or (), namespace

    def _pattern(self, name: str, args: tuple[nodes.Term, ...], item: nodes.Directive, namespace: str) -> None:
        """Count the plans as there that a pattern adds to those in its block."""
        with suppress(WrongPattern):  # reported as a wrong directive
            for plan in PATTERNS[name](item.position, args, item.items or ()):
                if isinstance(plan, nodes.Plan) and plan not in (item.items or ()):
                    self._place(plan, namespace)

    def _fact(self, item: nodes.Belief | nodes.Rule | nodes.Goal, namespace: str) -> None:
        match item:
            case nodes.Goal(literal, operator):
                self._literal(self.found.achieved if operator == "!" else self.found.asked, literal, namespace)
            case GroundFact() if self._is_another(item, namespace):
                pass
            case nodes.Belief(literal):
                self.found.beliefs.append(item)
                self._literal(self.found.added, literal, namespace)
            case nodes.Rule():
                self._rule(item, namespace)

    def _is_another(self, fact: GroundFact, namespace: str) -> bool:
        """Return whether a fact mentions only what one before it has: no variable, no call and the same predicate."""
        sig = fact.term().sig
        if (namespace, sig) in self._facts:
            return sig.functor not in USAGE
        self._facts.add((namespace, sig))
        return False

    def _rule(self, rule: nodes.Rule, namespace: str) -> None:
        self.found.rules.append(rule)
        self._literal(self.found.added, rule.head, namespace)
        self._formula(rule.body, namespace)

    def _place(self, plan: nodes.Plan, namespace: str) -> PlacedPlan:
        literal = plan.trigger.literal
        name = None
        if isinstance(literal, nodes.Structure) and not isinstance(literal.namespace, nodes.Variable):
            name = qualified(literal, namespace)
        placed = PlacedPlan(plan, name)
        self.found.plans.append(placed)
        return placed

    def _plan(self, plan: nodes.Plan, namespace: str) -> None:
        self._inside(plan.trigger.literal, namespace)
        for formula in (plan.context, plan.goal_condition):
            if formula is not None:
                self._formula(formula, namespace)
        self._pending.append(_Visit(plan.body, namespace))
        if plan.subplans:
            self.found.families.append([self._place(sub, namespace) for sub in plan.subplans])
            self._pending += (_Visit(sub, namespace) for sub in plan.subplans)

    # --- terms and formulas ------------------------------------------------------------------------------------------

    def _term(self, term: nodes.Term, namespace: str, data: bool = True) -> None:
        self._pending.append(_Visit(term, namespace, data=data))

    def _formula(self, term: nodes.Term, namespace: str, inverted: bool = False) -> None:
        self._pending.append(_Visit(term, namespace, True, inverted))

    def _visit(self, visit: _Visit) -> None:
        node, namespace, formula, inverted, data = visit
        match node:
            case nodes.Structure() | nodes.Variable():
                if formula and isinstance(node, nodes.Structure) and node.functor not in ("true", "false"):
                    self._mention(self.found.tested, node, namespace, inverted)
                self._inside(node, namespace)
            case nodes.InternalAction():
                self._call(node, namespace, not formula)
            case nodes.And(left, right) | nodes.Or(left, right):
                self._pending += (visit._replace(node=left), visit._replace(node=right))
            case nodes.Not(operand):
                self._pending.append(visit._replace(node=operand, inverted=not inverted))
            case nodes.Relation(left=left, right=right):
                self._term(left, namespace)
                self._term(right, namespace)
            case nodes.Arithmetic(operands=terms):
                for term in terms:
                    self._term(term, namespace)
            case nodes.ListTerm(items, tail):
                for term in (*items, *([tail] if tail is not None else ())):
                    self._term(term, namespace, data)
            case nodes.PlanTerm() | nodes.RuleTerm() | nodes.BodyTerm() | nodes.TriggerTerm():
                self._code(node, namespace, data)
            case nodes.Body(formulas):
                self.found.bodies.append(node)
                for step in formulas:
                    self._body_formula(step, namespace)
            case nodes.Plan():
                self._plan(node, namespace)

    def _code(self, node: nodes.Term, namespace: str, data: bool) -> None:
        match node:
            case nodes.TriggerTerm(trigger):
                if isinstance(trigger.literal, nodes.Structure):
                    self._mention(self.found.raised, trigger.literal, namespace)
                    if not data and trigger.operator == "+" and not trigger.goal:  # the body of a `.foreach`
                        self._mention(self.found.added, trigger.literal, namespace)
                self._term(trigger.literal, namespace)
            case nodes.PlanTerm(plan):
                self._place(plan, namespace)
                if not data:
                    self._plan(plan, namespace)
            case nodes.RuleTerm(rule) if not data:
                self._rule(rule, namespace)
            case nodes.BodyTerm(body) if not data:
                self._pending.append(_Visit(body, namespace))

    def _inside(self, literal: nodes.Structure | nodes.Variable, namespace: str) -> None:
        """Visit the arguments and annotations of a literal."""
        if isinstance(literal, nodes.Structure):
            for term in literal.args:
                self._term(term, namespace)
        if literal.annotations is not None:
            self._term(literal.annotations, namespace)

    def _call(self, action: nodes.InternalAction, namespace: str, as_term: bool) -> None:
        self.found.calls.append(Call(action, as_term))
        name, args = action.name, action.args
        query = _QUERIES.get(name) if name not in (".min", ".max") else 1 if len(args) == 3 else None
        if name in _ASSERTIONS and args:
            self._addition(args[0], namespace)
        self.found.looks_at_plans |= name in _LOOKERS
        self.found.ends_goals |= name in _ENDERS
        self.found.ends_others |= name in (".stopMAS", ".kill_agent")
        if name == ".add_plan":
            self.found.open_plans = self.found.open_beliefs = self.found.open_goals = True
        elif name in _FILE_READERS:
            self._files.append(action)
        elif name == ".save_agent" and args:
            self._saves_any |= not isinstance(args[0], nodes.String)
            self._saved |= {args[0].value} if isinstance(args[0], nodes.String) else set()
        match name, args:
            case (".send", (_, nodes.Structure(performative), content, *_)) | (
                ".broadcast",
                (nodes.Structure(performative), content),
            ):
                self._sent(performative, content, namespace)
        live = name in _RUNNERS or name in _ASSERTIONS
        for index, term in enumerate(args):
            # A query inside `not` is not what is inverted: `not .count(b(_), 0)` says nothing of b.
            self._pending.append(_Visit(term, namespace, index == query, data=not live))

    def _file(self, action: nodes.InternalAction) -> None:
        """Take in the file of an `.include`, note that of a new agent; what only the run knows leaves all open."""
        match action.name, action.args:
            case ".create_agent", (_,) | (_, nodes.String(""), *_):
                pass  # an agent without a program
            case (".include", (nodes.String(file), *_)) | (".create_agent", (_, nodes.String(file), *_)) if (
                self._saves_any or file in self._saved  # the program itself may write it: it need not be there yet
            ):
                self._known_late(action)
            case ".create_agent", (_, nodes.String(file), *_):
                self.found.created.append((file, action.position))
            case ".include", (nodes.String(),):
                self._read(self._includes(action, DEFAULT), DEFAULT)
            case ".include", (nodes.String(), nodes.Structure(into, ())):
                self._read(self._includes(action, into), into)
            case _, args if any(isinstance(term, nodes.Variable | nodes.InternalAction) for term in args):
                self._known_late(action)

    def _known_late(self, action: nodes.InternalAction) -> None:
        self.found.late_files.append(action)
        self.found.open_beliefs = self.found.open_goals = True
        if action.name == ".include":
            self.found.open_plans = True
        else:
            self.found.open_sent = self.found.open_wanted = True

    def _sent(self, performative: str, content: nodes.Term, namespace: str) -> None:
        self.found.teaches |= performative == "tellHow"
        self.found.open_plans |= performative == "askHow"  # without a variable for the answer, the plans are added
        self.found.ends_others |= performative in ("unachieve", "untellHow")
        goal = performative in ("achieve", "askOne", "askIf", "askAll")
        for term in content.items if isinstance(content, nodes.ListTerm) else (content,):
            if isinstance(term, nodes.Structure):
                self._mention(self.found.wanted if goal else self.found.sent, term, namespace)
                if performative in ("askOne", "askAll"):  # without a variable for the answer, that is believed
                    self._mention(self.found.added, term, namespace)
            elif isinstance(term, nodes.Variable) and goal:
                self.found.open_wanted = True
            elif isinstance(term, nodes.Variable):
                self.found.open_sent = True

    # --- bodies ------------------------------------------------------------------------------------------------------

    def _body_formula(self, formula: nodes.BodyFormula, namespace: str) -> None:
        match formula:
            case nodes.Step():
                self._step(formula, namespace)
            case nodes.If(branches, otherwise):
                for condition, body in branches:
                    self._formula(condition, namespace)
                    self._pending.append(_Visit(body, namespace))
                if otherwise is not None:
                    self._pending.append(_Visit(otherwise, namespace))
            case nodes.While(condition, body) | nodes.For(condition, body):
                self._formula(condition, namespace)
                self._pending.append(_Visit(body, namespace))
            case nodes.Fork(branches=bodies):
                self._pending += (_Visit(body, namespace) for body in bodies)

    def _step(self, step: nodes.Step, namespace: str) -> None:
        operator, term = step.operator, step.term
        if operator is Operator.TEST:
            if isinstance(term, nodes.Structure):
                self._literal(self.found.asked, term, namespace)
            else:
                self._formula(term, namespace)
        elif operator in _ADDITIONS:
            self._addition(term, namespace)
            self._term(term, namespace, data=False)
        elif (
            operator in _GOALS and isinstance(term, nodes.Structure) and not isinstance(term.namespace, nodes.Variable)
        ):
            self._literal(self.found.achieved, term, namespace)
        elif operator in _GOALS:
            self.found.open_goals = True
            self._term(term, namespace)
        elif operator is Operator.ACTION and isinstance(term, nodes.InternalAction):
            self._call(term, namespace, False)
        elif operator is Operator.ACTION and isinstance(term, nodes.Structure):
            if term.functor not in ("true", "false"):
                self._mention(self.found.actions, term, DEFAULT)  # what a robot does is in no namespace
            self._inside(term, namespace)
        elif operator is Operator.ACTION and isinstance(term, nodes.Relation | nodes.And | nodes.Or):
            self._formula(term, namespace)
        else:
            self._term(term, namespace, data=False)

    def _addition(self, term: nodes.Term, namespace: str) -> None:
        if isinstance(term, nodes.Structure) and not isinstance(term.namespace, nodes.Variable):
            self._mention(self.found.added, term, namespace)
        elif isinstance(term, nodes.Variable | nodes.Structure):
            self.found.open_beliefs = True
            self.found.open_plans = True

    def _literal(self, kind: list[Mention], literal: nodes.Structure, namespace: str) -> None:
        """Note a literal, and what is in it."""
        self._mention(kind, literal, namespace)
        self._inside(literal, namespace)

    def _mention(self, kind: list[Mention], literal: nodes.Structure, namespace: str, inverted: bool = False) -> None:
        if not isinstance(literal.namespace, nodes.Variable):
            name = qualified(literal, namespace)
            others = literal.annotations is not None and asks_others(literal.annotations)
            kind.append(Mention(name, literal, inverted, others))
