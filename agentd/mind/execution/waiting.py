"""What an intention may wait for besides its own event: times, formulas, events, answers, the team, Python code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.terms.source_annotations import is_source, told_by
from agentd.language.terms.terms import FALSE, Code, Literal, Term, Var, atom, deref, make_list, proper
from agentd.mind.beliefs.term_copy import nested_source
from agentd.mind.beliefs.unification import undo, unify
from agentd.mind.beliefs.work_limit import MOST_STEPS
from agentd.mind.data.effects import TeamRequest
from agentd.mind.data.formula_failure import Failed, argument, as_failed, wrong_arguments
from agentd.mind.data.inputs import Mail, TeamReply
from agentd.mind.data.intention import Frame, Intention, Question, Request, Wait
from agentd.mind.execution.execution import await_something, fail_waiting, resume_waiting
from agentd.mind.plans.plan_library import Relevant
from agentd.mind.plans.plan_terms import trigger_literal
from agentd.mind.state import MindState
from schemas.wire.mind_records import WaitView


def milliseconds(term: Term) -> float:
    """Return a time in milliseconds as a term, in seconds."""
    return max(0.0, argument(float, term, "a time is a number of milliseconds") / 1000.0)


def wait_time(mind: MindState, intention: Intention, seconds: float) -> bool:
    """Wait for ``seconds`` of mission time, from 0 on, then go on."""
    timer = mind.timers.at(mind.now + seconds, lambda: resume_waiting(mind, intention))
    await_something(mind, intention, WaitView(kind="time", seconds=seconds), timer)
    return True


def wait_until(
    mind: MindState,
    intention: Intention,
    frame: Frame,
    check: Any,
    limit: Term | None = None,
    elapsed: Term | None = None,
) -> bool | None:
    """Wait until a formula has a solution; ``limit`` in ms. Past it, fail, or go on if ``elapsed`` is asked for."""
    seconds = None if limit is None else milliseconds(limit)
    mark = len(intention.trail)
    if check(mind, intention, frame):
        if elapsed is not None:
            _tell_elapsed(intention, elapsed, 0.0)
        return None
    undo(intention.trail, mark)
    wait = Wait(intention, frame, mind.now)
    wait.check, wait.elapsed = check, elapsed
    mind.conditions.append(wait)
    _start(mind, wait, seconds, WaitView(kind="formula"))
    return True


def wait_event(
    mind: MindState, intention: Intention, trigger: Code, limit: Term | None = None, elapsed: Term | None = None
) -> bool:
    """Wait until an event unifies with a trigger."""
    seconds = None if limit is None else milliseconds(limit)
    node = trigger.syntax
    if not isinstance(node, nodes.Trigger):
        wrong_arguments(".wait takes an event in braces, such as { +b(X) }")
    wait = Wait(intention, None, mind.now)
    wait.pattern = (node.operator, node.goal, trigger_literal(trigger))
    wait.elapsed = elapsed
    mind.listeners.append(wait)
    _start(mind, wait, seconds, WaitView(kind="event"))
    return True


def _start(mind: MindState, wait: Wait, seconds: float | None, awaited: WaitView) -> None:
    mind.timers.looks += 1  # at the time since when it waits
    if seconds is not None:
        wait.timer = mind.timers.at(mind.now + seconds, lambda: timed_out(mind, wait))
    await_something(mind, wait.intention, awaited, wait)


def forget(mind: MindState, wait: Wait) -> None:
    """Take a wait off all lists."""
    if wait.timer is not None:
        mind.timers.cancel(wait.timer)
    if wait in mind.conditions:
        mind.conditions.remove(wait)
    if wait in mind.listeners:
        mind.listeners.remove(wait)


def timed_out(mind: MindState, wait: Wait) -> None:
    """End a wait that has lasted as long as it may: it fails unless the program has asked for the elapsed time."""
    if wait.elapsed is not None:
        ended(mind, wait)
    else:
        forget(mind, wait)
        fail_waiting(mind, wait.intention, Failed("wait_timeout", "timeout in .wait"))


def ended(mind: MindState, wait: Wait) -> None:
    """Resume after a wait: successful, or timed out where the program asked for the elapsed time."""
    forget(mind, wait)
    if wait.elapsed is not None:
        mind.timers.looks += 1
        _tell_elapsed(wait.intention, wait.elapsed, (mind.now - wait.since) * 1000.0)
    resume_waiting(mind, wait.intention)


def _tell_elapsed(intention: Intention, elapsed: Term, value: float) -> None:
    """Give the third argument of a wait the time that it took, in ms."""
    target = deref(elapsed)
    if type(target) is Var:
        unify(target, float(int(value)), intention.trail)


def check_conditions(mind: MindState) -> None:
    """Ask again every formula that is waited for, after beliefs have changed."""
    for wait in list(mind.conditions):
        if wait not in mind.conditions or wait.check is None:
            continue
        trail = wait.intention.trail
        mark = len(trail)
        mind.steps_left = MOST_STEPS
        try:
            holds = wait.check(mind, wait.intention, wait.frame)
        except Exception as error:  # as in a step: the formula fails, the mind goes on
            undo(trail, mark)
            forget(mind, wait)
            fail_waiting(mind, wait.intention, as_failed(error))
            continue
        if holds:
            ended(mind, wait)
        else:
            undo(trail, mark)


def hear(mind: MindState, relevant: Relevant, args: tuple[Term, ...], annots: tuple[Term, ...]) -> None:
    """Resume the intentions that wait for an event."""
    for wait in list(mind.listeners):
        assert wait.pattern is not None
        operator, goal, literal = wait.pattern
        if operator != relevant.operator or goal != relevant.goal:
            continue
        trail = wait.intention.trail
        mark = len(trail)
        if unify(literal, Literal(relevant.sig, args, annots), trail):
            ended(mind, wait)
        else:
            undo(trail, mark)


def signal(mind: MindState, relevant: Relevant, args: tuple[Term, ...], annots: tuple[Term, ...]) -> None:
    """Raise an event without a belief: for the intentions that wait for it, and as the start of one of its own."""
    if mind.listeners:
        hear(mind, relevant, args, annots)
    mind.post(relevant, args, annots)


# --- internal actions in Python ---


class Suspension:
    """The wait of an intention. It ends once, by `resume` or `fail`; of a dropped intention both do nothing."""

    def __init__(self, mind: MindState, reason: str) -> None:
        self._mind, self._intention = mind, mind.own_intention
        await_something(mind, self._intention, WaitView(kind="python", name=reason), self)

    @property
    def over(self) -> bool:
        """Whether the wait was ended or its intention dropped."""
        return self._mind.waiting.get(self._intention.id, (None, None))[1] is not self

    def resume(self) -> None:
        """End the wait: the formula has succeeded."""
        if not self.over:
            resume_waiting(self._mind, self._intention)

    def fail(self, error: str, message: str = "") -> None:
        """End the wait: the formula has failed with ``error`` and ``message``, which the handler sees."""
        if not self.over:
            fail_waiting(self._mind, self._intention, Failed(error, message))


def suspend(mind: MindState, reason: str) -> Suspension:
    """Suspend the intention that runs an internal action declared with ``suspends=True``; the action returns True."""
    return Suspension(mind, reason)


# --- requests to the team: agents to create and to end, the directory of services, files ---


def take_reply(mind: MindState, reply: TeamReply) -> None:
    """Let the intention that waits for a reply go on with it, or fail with its error."""
    request = mind.requests.pop(reply.id, None)
    if request is None:
        return
    intention = request.intention
    if reply.error:
        fail_waiting(mind, intention, Failed(reply.error, reply.message))
        return
    if request.use is not None:
        try:
            request.use(reply.value)
        except Exception as error:  # a function of the program's may raise anything; it must not end the mind
            fail_waiting(mind, intention, as_failed(error))
            return
    mark = len(intention.trail)
    if request.result is not None and not unify(request.result, reply.value, intention.trail):
        undo(intention.trail, mark)
        fail_waiting(mind, intention, Failed("ia_failed"))
        return
    resume_waiting(mind, intention)


def request(
    mind: MindState,
    what: str,
    arguments: tuple[Term, ...],
    result: Term | None = None,
    use: Callable[[Any], None] | None = None,
) -> bool:
    """Send a request; the running intention waits. ``result`` is unified with the answer."""
    if not mind.has_team:
        raise Failed("action_failed", f"nobody here can do what '{what}' asks for")
    mind.action_count += 1
    intention = mind.own_intention
    mind.effects.append(TeamRequest(mind.action_count, what, arguments))
    mind.requests[mind.action_count] = Request(intention, result, use)
    await_something(mind, intention, WaitView(kind="team", name=what), mind.action_count)
    return True


# --- synchronous asks, of one agent or of several ---


def wrong_answer() -> Failed:
    """Return the failure for an answer that is not of the form that the fourth argument of ``.send`` asks for."""
    return Failed("ask_failed", "the answer does not unify with what was expected")


def _credited(answer: Term, name: str) -> Any:
    """Return a literal with the agent that answered as its source, unless that has named itself already."""
    if type(answer) is not Literal or answer == FALSE or answer.annots == told_by(name):
        return answer
    sources = [a.with_annots(()) for a in answer.annots if is_source(a)]
    if sources == list(told_by(name)):
        return answer
    return answer.with_annots(nested_source(answer.annots, name))


def take_answer(mind: MindState, question: Question, mail: Mail) -> None:
    """Note an answer; the last one resumes the intention."""
    mind.questions.pop(mail.in_reply_to, None)
    question.found.append(_answer(question, mail))
    if len(question.found) == len(question.receivers):
        _finish(mind, question, make_list(question.found) if question.many else question.found[0])


def _answer(question: Question, mail: Mail) -> Any:
    """Return an answer as the plan gets it: literals, also those in the list for `askAll`, name their sender."""
    content = deref(mail.content)
    if mail.performative == "untell" and question.performative in ("askOne", "askIf"):
        return FALSE
    if type(content) is Literal:
        return _credited(content, mail.sender)
    members = proper(content) if question.performative == "askAll" else None
    return content if members is None else make_list([_credited(deref(m), mail.sender) for m in members])


def time_out(mind: MindState, question: Question) -> None:
    """Go on with the answers so far, or with ``timeout``."""
    _finish(mind, question, make_list(question.found) if question.many else atom("timeout"))


def forget_question(mind: MindState, question: Question) -> None:
    """Wait for no further answer."""
    if question.timer is not None:
        mind.timers.cancel(question.timer)
    for msg_id in question.ids:
        mind.questions.pop(msg_id, None)


def _finish(mind: MindState, question: Question, value: Term) -> None:
    forget_question(mind, question)
    trail = question.intention.trail
    mark = len(trail)
    if unify(question.answer, value, trail):
        resume_waiting(mind, question.intention)
    else:
        undo(trail, mark)
        fail_waiting(mind, question.intention, wrong_answer())
