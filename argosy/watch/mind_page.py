"""The mind of one agent: intentions, actions, events, beliefs, and decisions with their reasons."""

from __future__ import annotations

from rich.text import Text

from agentd.standalone.decision_printer import decision_lines, failure_lines
from argosy.cli.remedies import level_of
from argosy.fleet_model.activity import activity
from argosy.fleet_model.members import FleetAgent
from argosy.fleet_model.model import FleetModel
from argosy.watch.overview_page import action_text
from argosy.watch.row_text import BAD, DIM, GOOD, WARN, Glyphs, Row, head, joined, place, places, rounded, safe_text
from argosy.why.wording import awaited
from schemas.humanize import count, span
from schemas.liveness import LAG_LATE, STALE_AFTER
from schemas.wire.mind_records import DecisionView, FailureView, IntentionView, MindView

MOST_OUTCOMES = 5
"""Actions that have ended that are shown."""


def seen(agent: FleetAgent) -> tuple[MindView | None, float | None]:
    """Return the detailed view of a mind, or the summary if it is newer, and its time."""
    if agent.detail is not None and (agent.heard or 0.0) - (agent.detailed or 0.0) <= STALE_AFTER:
        return agent.detail, agent.detailed
    return agent.mind, agent.heard


def title(model: FleetModel, agent: FleetAgent) -> Text:
    """Return name and state of an agent in one line."""
    view, heard = seen(agent)
    now = model.as_of
    if view is None or heard is None:
        why = f"its mind has not answered yet {agent.why_silent}".strip()
        return joined((agent.name, "bold"), (why if agent.there else "it is not running", WARN))
    old, does = now - heard, activity(model, agent)
    return joined(
        (agent.name, "bold"),
        (does.doing, {"paused": WARN, "waiting": "", "idle": ""}.get(does.doing, GOOD)),
        (f"board {agent.board}" if agent.board else "", DIM),
        (f"robot {agent.robot}" if agent.robot else "", DIM),
        f"cycle {view.cycle}",
        f"{model.clock.seconds(heard) or view.time:.0f} s of mission",
        rounded(does.action),
        (f"lag {span(agent.lag)}", BAD if agent.lag >= LAG_LATE else DIM),
        (f"{agent.drops} dropped" if agent.drops else "", WARN),
        (_age(agent, old), BAD),
    )


def _age(agent: FleetAgent, old: float) -> str:
    if agent.ended:
        return ""
    if not agent.there:
        return f"GONE, as it was {span(old)} ago"
    if agent.silent is not None:
        return f"SILENT, as it was {span(old)} ago"
    return f"as it was {span(old)} ago" if old > STALE_AFTER else ""


def mind(model: FleetModel, agent: FleetAgent, glyphs: Glyphs) -> list[Row]:
    """Return intentions, actions, events, questions, mail and the mission's formulas."""
    view, _ = seen(agent)
    rows: list[Row] = [
        Row(safe_text(f"! {note.text}", BAD if level_of(note) == "error" else WARN)) for note in agent.notes
    ]
    if view is None:
        return [*rows, Row(Text("its mind has not answered yet", WARN))]
    if view.paused_for is not None:
        rows.append(Row(Text(f"the operator has paused it; it continues by itself in {span(view.paused_for)}", WARN)))
    rows.append(head(f"intentions {_of(len(view.intentions), view.intentions_left_out)}"))
    for intention in view.intentions:
        rows += _intention(intention, view, glyphs)
    rows += _actions(model, agent, glyphs)
    rows.append(head(f"events that wait {_of(len(view.events), view.events_left_out)}"))
    rows += [
        Row(joined(f"  {event.text}", (f"of intention {event.intention}" if event.intention else "", DIM)), indent=4)
        for event in view.events
    ]
    if view.questions:
        rows.append(head(f"questions without an answer {len(view.questions)}"))
    for question in view.questions:
        asked = f"for {span(view.time - question.asked)}"
        until = f"gives up in {span(question.until - view.time)}" if question.until is not None else "never gives up"
        what = f"  {question.performative} {question.content}"
        rows.append(Row(joined(f"  to {question.receiver}", what, (f"{asked}, {until}", DIM)), indent=4))
    rows += _mail(model, agent, view)
    if view.dropped:
        rows.append(head("dropped"))
        rows += [Row(Text(f"  {number} {what}", WARN)) for what, number in view.dropped.items()]
    if formulas := {**view.done, **view.failed}:
        rows.append(head("the mission's formulas"))
        rows += [_formula(text, holds, text in view.failed, glyphs) for text, holds in formulas.items()]
    return rows


def _intention(intention: IntentionView, view: MindView, glyphs: Glyphs) -> list[Row]:
    since = span(view.time - intention.since) if intention.since is not None else ""
    style = {"running": GOOD, "suspended": WARN}.get(intention.state, "")
    rows = [
        Row(
            joined(
                (f"  {intention.id}", DIM),
                (intention.state + awaited(intention.waits_for, " for "), style),
                (since, DIM),
                (place(intention.at), DIM),
            ),
            indent=6,
        )
    ]
    for depth, trigger in enumerate(intention.stack):
        rows.append(
            Row(safe_text(f"     {f'{glyphs.under} ' if depth else '  '}{trigger}", "" if depth else "bold"), indent=9)
        )
    return rows


def _actions(model: FleetModel, agent: FleetAgent, glyphs: Glyphs) -> list[Row]:
    running = model.actions.open(agent.name)
    ended = [one for one in model.actions.by_id.values() if one.agent == agent.name and one.ended is not None]
    rows = [head(f"actions {len(running)} running")] if running or ended else []
    rows += [Row(joined(" ", action_text(model, one, glyphs, one.state), gap=" "), indent=6) for one in running]
    for action in ended[: -MOST_OUTCOMES - 1 : -1]:
        ago = f"{span((model.as_of - (action.ended or 0.0)) * model.clock.speed)} ago"
        style = GOOD if action.state == "succeeded" else WARN
        rows.append(Row(joined(f"    {action.text}", (action.state, style), action.reason, (ago, DIM)), indent=6))
    return rows


def _mail(model: FleetModel, agent: FleetAgent, view: MindView) -> list[Row]:
    queues = [
        (board.name, queue)
        for board in model.boards.values()
        if board.mailboxes is not None
        for queue in board.mailboxes.queues
        if agent.name in (queue.sender, queue.receiver)
    ]
    rows = [head(f"mail {view.mailbox} taken in and not read")]
    for board, queue in queues:
        what = f"  {queue.sender} > {queue.receiver}  {count(queue.messages, 'message')} in the {queue.box} of {board}"
        rows.append(Row(joined(what, (f"oldest {span(queue.oldest)}", DIM), (queue.state, WARN)), indent=4))
    problems = [(board.name, board.problem) for board in model.boards.values() if board.problem]
    return rows + [Row(safe_text(f"  {name}: {problem}", WARN), indent=4) for name, problem in problems]


def _formula(text: str, holds: bool, bad: bool, glyphs: Glyphs) -> Row:
    style = (BAD if bad else GOOD) if holds else DIM
    return Row(
        joined(
            (f"  {glyphs.well if holds else glyphs.away}", style), text, ("failed when" if bad else "done when", DIM)
        )
    )


def _old(agent: FleetAgent, now: float) -> list[Row]:
    """Return the age of the details, if they are old."""
    old = now - (agent.detailed or now)
    return [Row(Text(f"as it was {span(old)} ago", BAD))] if old > STALE_AFTER else []


def beliefs(agent: FleetAgent, now: float) -> list[Row]:
    """Return the beliefs by source, each with its age in mission seconds; `now` is in seconds of the model's clock."""
    view = agent.detail
    if view is None:
        word = "its mind has not answered yet" if agent.mind is None else "not asked for yet"
        return [Row(Text(word, WARN))]
    groups: dict[str, list[Row]] = {}
    for belief in view.beliefs:
        age = f"{span(view.time - belief.since)}" if belief.since is not None else ""
        sources = f"[{','.join(f'source({source})' for source in belief.sources)}]"  # the heading has them
        row = Row(joined(f"  {belief.text.removesuffix(sources)}", (age, DIM)), indent=4)
        groups.setdefault(", ".join(belief.sources) or "without a source", []).append(row)
    rows = _old(agent, now)
    for source in sorted(groups, key=lambda one: ({"percept": 1, "self": 2}.get(one, 0), one)):
        rows += [head(f"from {source} {len(groups[source])}"), *groups[source]]
    if view.beliefs_left_out:
        rows.append(Row(Text(f"{view.beliefs_left_out} more beliefs are not shown", WARN)))
    return rows or [Row(Text("it has no beliefs", DIM))]


def decisions(agent: FleetAgent, opened: set[str], now: float) -> list[Row]:
    """Return the last decisions at `now`, in seconds, the newest first; those in `opened` with their reasons."""
    view = agent.detail
    if view is None:
        return [Row(Text("not asked for yet", WARN))]
    rows = _old(agent, now)
    together: list[tuple[int, str, DecisionView | FailureView]] = []
    together += [(one.cycle, f"d{one.cycle} {one.event}", one) for one in view.decisions]
    together += [(one.cycle, f"f{one.cycle} {one.formula}", one) for one in view.failures]
    for _, key, one in sorted(together, key=lambda found: found[0], reverse=True):
        rows.append(_failure(one, key) if isinstance(one, FailureView) else _decision(one, key))
        if key in opened:
            lines = failure_lines(one) if isinstance(one, FailureView) else decision_lines(one)
            rows += [Row(safe_text(f"      {places(line)}"), indent=10) for line in lines]
            if isinstance(one, DecisionView) and one.dropped_by:
                where = f" ({one.dropped_at})" if one.dropped_at else ""
                rows.append(Row(safe_text(f"      dropped by {one.dropped_by}{where}"), indent=10))
    return rows or [Row(Text("no decision is remembered", DIM))]


def _decision(view: DecisionView, key: str) -> Row:
    chosen = f"by {place(view.chosen.position)}" if view.chosen is not None else "no plan"
    rejected = f"{len(view.rejected)} not" if view.rejected else ""
    outcome = {"failed": BAD, "none": BAD, "dropped": WARN, "ended": GOOD}.get(view.outcome, "")
    word = "no plan" if view.outcome == "none" else view.outcome
    if view.outcome == "none" and not {"!", "?"} & set(view.kind):
        outcome = DIM  # most belief events have no plan
    return Row(
        joined(
            (f"{view.time:8.1f} s", DIM),
            view.event,
            (chosen if view.chosen is not None else "", DIM),
            (rejected, DIM),
            (word, outcome),
        ),
        key,
        indent=12,
    )


def _failure(view: FailureView, key: str) -> Row:
    why = f"{view.error}: {view.reason}" if view.reason else view.error
    return Row(
        joined((f"{view.time:8.1f} s", DIM), f"{view.formula} fails", (why, BAD), (place(view.position), DIM)),
        key,
        indent=12,
    )


def _of(shown: int, left_out: int) -> str:
    return f"{shown} of {shown + left_out}" if left_out else str(shown)
