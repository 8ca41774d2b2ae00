"""Beliefs and rules: ``.abolish``, ``.asserta``, ``.assertz``, ``.belief``, ``.relevant_rules``, ``.namespace``."""

from __future__ import annotations

from collections.abc import Iterator

from agentd.language.syntax_tree import nodes
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.terms import Code, Literal, Open, Term, Var, atom, deref, make_list
from agentd.mind.beliefs.belief_base import Predicate, RuleClause
from agentd.mind.beliefs.term_copy import Copier, detach, resolve_all, resolve_annots, with_source
from agentd.mind.beliefs.unification import Trail, alternatives, undo, unify
from agentd.mind.data.formula_failure import Failed, argument, wrong_arguments
from agentd.mind.data.registry import internal_action
from agentd.mind.execution.belief_updates import add_rule, believe, raise_event
from agentd.mind.execution.input_handling import forget
from agentd.mind.state import MindState


@internal_action(".abolish", 1)
def abolish(mind: MindState, trail: Trail, pattern: Term) -> bool:
    """``.abolish(B)``: removes every belief that unifies, from any source, with a deletion event each.

    ``.abolish(_[source(ann)])``: every belief with that annotation, whatever its name. The events have no annotations.
    """
    pattern = deref(pattern)
    if type(pattern) is Literal:
        _abolish(mind, trail, pattern, mind.beliefs.predicate(pattern.sig))
    elif type(pattern) is Open and pattern.annots:
        for predicate in list(mind.beliefs.predicates()):
            _abolish(mind, trail, pattern, predicate)
    else:
        wrong_arguments(".abolish takes a belief, or a variable with annotations")
    return True


def _abolish(mind: MindState, trail: Trail, pattern: Term, predicate: Predicate) -> None:
    """Remove the facts of a predicate that unify with a belief, or with a variable that has annotations."""
    for fact in predicate.candidates(pattern.args) if type(pattern) is Literal else predicate.facts():
        mark = len(trail)
        if unify(pattern, fact, trail):
            predicate.remove(fact)
            mind.changes += 1
            forget(mind, predicate.sig, fact.args)
            raise_event(mind, None, mind.plans.relevant("-", "", predicate.sig), fact.args, ())
        undo(trail, mark)


def _assert(mind: MindState, term: Term, last: bool) -> bool:
    term = deref(term)
    if type(term) is Code and isinstance(term.syntax, nodes.Rule):
        add_rule(mind, term.syntax, dict(term.values), last=last)
        return True
    if type(term) is not Literal:
        raise Failed("unknown", "only beliefs and rules can be asserted")
    annots = resolve_annots(term.annots if last else with_source(term.annots))
    predicate = mind.beliefs.predicate(term.sig)
    relevant = mind.plans.relevant("+", "", term.sig)
    believe(mind, None, predicate, relevant, detach(resolve_all(term.args)), annots, last)
    return True


@internal_action(".asserta", 1)
def asserta(mind: MindState, trail: Trail, term: Term) -> bool:
    """``.asserta(B)``: believes B, or adds the rule B, before all others of its name."""
    return _assert(mind, term, last=False)


@internal_action(".assertz", 1)
def assertz(mind: MindState, trail: Trail, term: Term) -> bool:
    """``.assertz(B)``: as ``.asserta``, after all others of its name."""
    return _assert(mind, term, last=True)


@internal_action(".belief", 1, backtracks=True, pure=True)
def belief(mind: MindState, trail: Trail, pattern: Term) -> Iterator[None]:
    """``.belief(B)``: each fact that unifies; rules are not asked.

    ?- .belief(door(D)) gives D = open; D = closed
    """
    pattern = deref(pattern)
    if type(pattern) is Var:
        facts = list(mind.beliefs.facts())
    elif type(pattern) is Literal:
        known = mind.beliefs.known(pattern.sig)
        facts = [] if known is None else known.candidates(pattern.args)
    else:
        wrong_arguments(".belief takes a belief")
    mark = len(trail)
    for fact in facts:
        if unify(pattern, fact if fact.ground else Copier(fresh=True).copy(fact), trail):
            yield None
        undo(trail, mark)


@internal_action(".relevant_rules", 2, pure=True)
def relevant_rules(mind: MindState, trail: Trail, pattern: Term, result: Term) -> bool:
    """``.relevant_rules(H, L)``: the rules whose head unifies, as terms."""
    head = argument(Literal, pattern, ".relevant_rules takes the head of a rule")
    known = mind.beliefs.known(head.sig)
    found = []
    for entry in [] if known is None else list(reversed(known.entries.values())):
        if type(entry) is not RuleClause:
            continue
        mark = len(trail)
        if unify(head.bare(), instantiate(entry.syntax.head, dict(entry.values)), trail):
            found.append(Code(entry.syntax, entry.values))
        undo(trail, mark)
    return unify(result, make_list(found), trail)


@internal_action(".namespace", 1, backtracks=True)
def namespace(mind: MindState, trail: Trail, name: Term) -> Iterator[None]:
    """``.namespace(N)``: the namespaces in use.

    ?- .namespace(N) gives N = default
    """
    found = dict.fromkeys(["default", *[p.sig.namespace for p in mind.beliefs.predicates()], *mind.namespaces])
    yield from alternatives(name, map(atom, found), trail)


@internal_action(".namespace_set_prop", 3)
def namespace_set_prop(mind: MindState, trail: Trail, name: Term, key: Term, term: Term) -> bool:
    """``.namespace_set_prop(N, Key, V)``: keeps a value under a key of a namespace."""
    mind.namespaces.setdefault(_name(name), {})[_name(key)] = resolve_all((term,))[0]
    return True


@internal_action(".namespace_get_prop", (2, 4), backtracks=True)
def namespace_get_prop(
    mind: MindState, trail: Trail, name: Term, key: Term, term: Term | None = None, default: Term | None = None
) -> Iterator[None]:
    """``.namespace_get_prop(N, Key[, V[, Default]])``: the value under a key, or under each key where Key is free.

    A missing key without default leaves V free and succeeds.
    """
    known = mind.namespaces.get(_name(name), {})
    mark = len(trail)
    term = Var() if term is None else term
    if type(deref(key)) is Var:
        for each, found in list(known.items()):
            if unify(key, atom(each), trail) and unify(term, found, trail):
                yield None
            undo(trail, mark)
        return
    found = known.get(_name(key), default)
    if found is None or unify(term, found, trail):
        yield None
    undo(trail, mark)


def _name(term: Term) -> str:
    term = deref(term)
    return term.sig.functor if type(term) is Literal else str(term)
