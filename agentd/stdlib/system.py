"""The agent's own name and failure, and the end of the team."""

from __future__ import annotations

from agentd.language.terms.source_annotations import is_source
from agentd.language.terms.terms import Literal, Term, atom
from agentd.mind.beliefs.term_copy import resolve_all
from agentd.mind.beliefs.unification import Trail, unify
from agentd.mind.data.effects import AskPercepts, StopTeam
from agentd.mind.data.formula_failure import Failed, argument, wrong_arguments
from agentd.mind.data.registry import internal_action
from agentd.mind.state import MindState


@internal_action(".my_name", 1, pure=True)
def my_name(mind: MindState, trail: Trail, name: Term) -> bool:
    """``.my_name(N)``: the agent's own name."""
    return unify(name, atom(mind.name), trail)


@internal_action(".stopMAS", (0, 2))
def stop_mas(mind: MindState, trail: Trail, delay: Term = 0.0, code: Term = 0.0) -> bool:
    """``.stopMAS([Ms[, ExitCode]])``: ends the team, immediately or after a delay in ms."""
    needed = ".stopMAS takes milliseconds and an exit code"
    milliseconds, exit_code = argument(float, delay, needed), argument(float, code, needed)
    mind.effects.append(StopTeam(int(exit_code), milliseconds / 1000.0))
    return True


@internal_action(".fail", (0, None))
def fail(mind: MindState, trail: Trail, *args: Term) -> bool:
    """``.fail(Annotation, ...)``: the plan fails; the arguments become annotations of the failure event."""
    if not args:
        raise Failed("ia_failed")
    annots = resolve_all(args)
    message = ""
    for annot in annots:
        if type(annot) is Literal and annot.sig.functor == "error_msg" and len(annot.args) == 1:
            message = str(annot.args[0])
    raise Failed("internal_action", message, tuple(a for a in annots if not is_source(a)))


@internal_action(".perceive", 0)
def perceive(mind: MindState, trail: Trail) -> bool:
    """``.perceive``: brings the percepts up to date before the next formula."""
    mind.effects.append(AskPercepts())
    return True


@internal_action(".version", 1, pure=True)
def version(mind: MindState, trail: Trail, result: Term) -> bool:
    """``.version(V)``: the name of the interpreter, ``"argosy"``.

    ?- .version(V) gives V = "argosy"
    """
    return unify(result, "argosy", trail)


@internal_action(".join", (0, None))
def join(mind: MindState, trail: Trail, *args: Term) -> bool:
    """``.join``: ends the branches of a ``.fork`` in Jason; it is not for programs."""
    return wrong_arguments(".join ends the branches of .fork by itself and is not to be called")
