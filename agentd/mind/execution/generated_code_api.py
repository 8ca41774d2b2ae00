"""The names that generated code may use besides its constants."""

from __future__ import annotations

from typing import Any, Final

from agentd.language.terms import order, source_annotations, terms
from agentd.mind.beliefs import dynamic_formulas, term_copy, unification, work_limit
from agentd.mind.data import formula_failure
from agentd.mind.execution import belief_updates, control_flow, goal_execution, goal_states, waiting
from agentd.mind.introspection import term_snapshot
from agentd.mind.plans import plan_terms

_NAMES: Final = {
    terms: "EMPTY FALSE TRUE Expression List Literal Open Rest Var atom deref elements make_list",
    source_annotations: "SELF",
    order: "distinct ordered sorted_annots",
    dynamic_formulas: "arithmetic call order same solve univ",
    term_copy: "annots_with_tail detach is_ground resolve resolve_annots with_source",
    unification: "bound_again in_default open_bare open_list open_structure subsets undo unify value",
    work_limit: "too_much_work",
    plan_terms: "capture",
    formula_failure: "action_said_no constraint_failed test_failed",
    belief_updates: "believe believed change_term disbelieve replace",
    control_flow: "begin_rounds fork free_again join next_round present",
    goal_execution: "achieve_term perform qualify run_term test_event test_term",
    goal_states: "pending",
    term_snapshot: "held",
    waiting: "wait_until",
}

RUNTIME: Final[dict[str, Any]] = {
    name: getattr(module, name) for module, names in _NAMES.items() for name in names.split()
}
