"""The names that generated code may use besides its constants."""

from __future__ import annotations

from typing import Any, Final

from agentd.language.terms.order import distinct, ordered, sorted_annots
from agentd.language.terms.source_annotations import SELF
from agentd.language.terms.terms import (
    EMPTY,
    FALSE,
    TRUE,
    Expression,
    List,
    Literal,
    Open,
    Rest,
    Var,
    atom,
    deref,
    elements,
    make_list,
)
from agentd.mind.beliefs.dynamic_formulas import arithmetic, call, order, same, solve, univ
from agentd.mind.beliefs.term_copy import annots_with_tail, detach, is_ground, resolve, resolve_annots, with_source
from agentd.mind.beliefs.unification import (
    bound_again,
    in_default,
    open_bare,
    open_list,
    open_structure,
    subsets,
    undo,
    unify,
    value,
)
from agentd.mind.beliefs.work_limit import too_much_work
from agentd.mind.data.formula_failure import action_said_no, constraint_failed
from agentd.mind.execution.belief_updates import believe, change_term, disbelieve, replace
from agentd.mind.execution.control_flow import begin_rounds, fork, free_again, join, next_round, present
from agentd.mind.execution.goal_execution import (
    achieve_term,
    perform,
    qualify,
    run_term,
    test_event,
    test_failed,
    test_term,
)
from agentd.mind.execution.goal_states import pending
from agentd.mind.execution.waiting import wait_until
from agentd.mind.introspection.term_snapshot import held
from agentd.mind.plans.plan_terms import capture

RUNTIME: Final[dict[str, Any]] = {
    "EMPTY": EMPTY,
    "FALSE": FALSE,
    "SELF": SELF,
    "TRUE": TRUE,
    "Expression": Expression,
    "List": List,
    "Literal": Literal,
    "Open": Open,
    "Rest": Rest,
    "Var": Var,
    "achieve_term": achieve_term,
    "action_said_no": action_said_no,
    "sorted_annots": sorted_annots,
    "annots_with_tail": annots_with_tail,
    "arithmetic": arithmetic,
    "begin_rounds": begin_rounds,
    "atom": atom,
    "believe": believe,
    "bound_again": bound_again,
    "call": call,
    "capture": capture,
    "change_term": change_term,
    "constraint_failed": constraint_failed,
    "deref": deref,
    "detach": detach,
    "disbelieve": disbelieve,
    "distinct": distinct,
    "elements": elements,
    "fork": fork,
    "held": held,
    "free_again": free_again,
    "in_default": in_default,
    "is_ground": is_ground,
    "join": join,
    "make_list": make_list,
    "open_bare": open_bare,
    "open_list": open_list,
    "open_structure": open_structure,
    "order": order,
    "next_round": next_round,
    "ordered": ordered,
    "pending": pending,
    "perform": perform,
    "present": present,
    "qualify": qualify,
    "replace": replace,
    "resolve": resolve,
    "resolve_annots": resolve_annots,
    "run_term": run_term,
    "same": same,
    "solve": solve,
    "subsets": subsets,
    "test_event": test_event,
    "test_failed": test_failed,
    "test_term": test_term,
    "too_much_work": too_much_work,
    "undo": undo,
    "unify": unify,
    "univ": univ,
    "value": value,
    "wait_until": wait_until,
    "with_source": with_source,
}
