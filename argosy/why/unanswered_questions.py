"""Explain where an unanswered question is: at a board, at its receiver, or on the way back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import msgspec

from argosy.why.answer import Line, Paragraph
from argosy.why.decision_history import Memory
from argosy.why.question import parts_of
from argosy.why.wording import ago, awaited, event_text, failure_text, plan_text, raiser_text, rejected_text, shown
from schemas.files.findings import near_miss
from schemas.humanize import span
from schemas.wire.mind_records import DecisionView, MindView, QuestionView
from schemas.wire.records import Mailboxes
from schemas.wire.term_text import write


class MailFacts(msgspec.Struct):
    """Answers of the boards and the other agents."""

    boards: list[Mailboxes] = []
    silent: dict[str, str] = {}
    """Boards that did not answer, and why."""
    homes: dict[str, str] = {}
    """The board of each agent that some board knows."""
    minds: dict[str, MindView] = {}
    """Of the agents that were asked and answered."""
    asked: bool = False
    """Whether boards and receivers were asked."""


def question_paragraph(memory: Memory, question: QuestionView, facts: MailFacts) -> Paragraph:
    """Explain an open question, and where it or its answer is now."""
    at = f" at {question.position}" if question.position else ""
    what = f"{question.performative} {shown(question.content)}"
    head = f"{ago(memory.now, question.asked)}: asked {question.receiver}{at}: {what}. No answer yet."
    lines = [Line(head, 0, question.position)]
    goal = next((i.stack[0] for i in memory.view.intentions if i.id == question.intention and i.stack), "")
    who = raiser_text(goal) if goal else "The plan"
    if question.until is None:
        lines.append(Line(f"{who} waits for the answer without a time limit.", 1))
    else:
        left = f"{span(max(0.0, question.until - memory.now))} more, then continues with the answer `timeout`"
        lines.append(Line(f"{who} waits for it {left}.", 1))
    if facts.asked:
        lines += [Line(text, 1, place) for text, place in _whereabouts(memory.view.agent, question, facts)]
    return Paragraph("question", tuple(lines), question.asked)


def _whereabouts(agent: str, question: QuestionView, facts: MailFacts) -> Iterator[tuple[str, str]]:
    receiver = question.receiver
    if reason := _given_up(question.id, facts.boards):
        yield f"The message is a dead letter: {shown(reason)}.", ""
        return
    waiting = list(_queues(agent, receiver, facts.boards))
    if waiting:
        yield from ((text, "") for text in waiting)
        return
    home = facts.homes.get(receiver)
    mind = facts.minds.get(receiver)
    if mind is None:
        if home is None and facts.homes:
            hint = f"; known are {', '.join(sorted(facts.homes))}."
            yield f"No board knows an agent `{receiver}`{near_miss(receiver, facts.homes) or hint}", ""
        elif home is not None and home in facts.silent:
            yield f"{receiver} belongs to {home}, which does not answer: {facts.silent[home]}.", ""
        else:
            yield f"No board holds the message, and {receiver} does not answer queries.", ""
        return
    yield from _with_receiver(agent, question, mind, facts)


def _given_up(identity: str, boards: Iterable[Mailboxes]) -> str:
    for board in boards:
        for letter in board.dead:
            if letter.message.id == identity or letter.message.id.startswith(f"{identity}."):
                return str(letter.reason)
    return ""


def _queues(sender: str, receiver: str, boards: Iterable[Mailboxes], what: str = "The message") -> Iterator[str]:
    for board in boards:
        for queue in board.queues:
            if (queue.sender, queue.receiver) != (sender, receiver):
                continue
            it = f"{what} waits" if queue.messages == 1 else f"It is one of {queue.messages} messages that wait"
            whose = (
                f"the outbox of {board.board}" if queue.box == "outbox" else f"{receiver}'s mailbox at {board.board}"
            )
            state = shown(queue.state) or f"{receiver} does not take its mail"
            yield f"{it} in {whose}: {state}."


def _with_receiver(agent: str, question: QuestionView, mind: MindView, facts: MailFacts) -> Iterator[tuple[str, str]]:
    receiver = question.receiver
    if mind.state == "paused":
        yield f"{receiver} is paused by an operator.", ""
    if mind.mailbox:
        yield f"{receiver} has received it and not read it yet: {mind.mailbox} messages are unread.", ""
        return
    _, name, args = parts_of(question.content)
    made = _decision(agent, name, len(args), mind)
    if made is not None:
        yield from _decided(receiver, made, mind)
        return
    back = list(_queues(receiver, agent, facts.boards, "Its answer"))
    if back:
        yield f"{receiver} has answered. {back[0]}", ""
        return
    if mind.plans and not any(plan.trigger.startswith(f"+?{name}") for plan in mind.plans):
        yield f"{receiver} has no plan for +?{name}: it answers from its beliefs.", ""
    yield f"{receiver} has no trace of it: the answer is on its way, or was lost in a restart.", ""


def _decision(agent: str, name: str, arity: int, mind: MindView) -> DecisionView | None:
    for made in reversed(mind.decisions):
        if made.kind == "+?" and made.name == f"{name}/{arity}" and made.source == agent:
            return made
    return None


def _decided(receiver: str, made: DecisionView, mind: MindView) -> Iterator[tuple[str, str]]:
    if made.chosen is None:
        yield f"{receiver} received it, and none of its plans was applicable for {event_text(made.event)}:", ""
        for one in made.rejected[:4]:
            yield f"  not {plan_text(one.plan)}: {rejected_text(one)}.", one.plan.position
        return
    plan = plan_text(made.chosen)
    place = made.chosen.position
    if made.outcome == "running":
        intention = next((one for one in mind.intentions if one.id == made.intention), None)
        doing = ""
        if intention is not None:
            doing = f": it is at {intention.at}{awaited(intention.waits_for, ', and waits for ')}"
        yield f"{receiver} received it and chose the plan {plan}, which still runs{doing}.", place
    elif made.outcome == "failed" and made.failure is not None:
        at = made.failure.position
        yield (
            f"{receiver} received it and chose the plan {plan}, which failed at {at}: {failure_text(made.failure)}.",
            at,
        )
        yield "This failure sends no answer.", ""
    elif made.outcome == "dropped":
        yield f"{receiver} received it and chose the plan {plan}, which was dropped: no answer will come.", place
    else:
        yield f"{receiver} has answered with the plan {plan}: the answer is on its way.", place


def dead_letters(agent: str, facts: MailFacts, now_ns: int) -> Iterator[Paragraph]:
    """Report dead letters of the agent, for which no plan waits; `now_ns` is in Unix nanoseconds."""
    for board in facts.boards:
        for letter in board.dead:
            message = letter.message
            if message.sender != agent:
                continue
            what = f"{message.performative} {shown(write(message.content))} to {message.receiver}"
            when = f"{span(max(0.0, (now_ns - letter.stamp) / 1e9))} ago by the clock"
            yield Paragraph("dropped", (Line(f"{when}: {board.board} gave up the message {what}: {letter.reason}."),))
