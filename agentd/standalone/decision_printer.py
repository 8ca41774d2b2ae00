"""``agentd run --why``: write each decision of the agents to standard error when it is made."""

from __future__ import annotations

import argparse
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable

from schemas.files.findings import did_you_mean
from schemas.humanize import escape_lines
from schemas.wire.mind_records import CauseView, DecisionView, FailureView, PlanView

IN_FULL = 3
"""Decisions with the same reasons that are written; further ones are counted."""

MOST_SUMMED_UP = 20
"""Kinds of counted decisions that are named at the end."""

View = DecisionView | FailureView


def add_why_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments for output about decisions."""
    parser.add_argument(
        "--why",
        action="store_true",
        help="write to standard error which plan was chosen for each event, which plans were rejected and why, and "
        "what failed; decisions with the same reasons are written three times, then counted",
    )
    parser.add_argument(
        "--why-about",
        action="append",
        default=[],
        metavar="NAME",
        help="as --why, for all decisions about goals and beliefs of this name and for no others (repeatable)",
    )
    parser.add_argument(
        "--decisions",
        type=int,
        default=0,
        metavar="N",
        help="keep the last N decisions of each agent as 'agentd serve' does, to measure what that costs (default 0)",
    )


def narrator_of(args: argparse.Namespace) -> DecisionPrinter | None:
    """Return the printer that the arguments ask for; None without `--why` and `--why-about`."""
    return DecisionPrinter(args.why_about) if args.why or args.why_about else None


class DecisionPrinter:
    """Passes decisions to ``write`` line by line. ``about`` are names of goals and beliefs; empty: all."""

    def __init__(self, about: Iterable[str] = (), write: Callable[[str], object] | None = None) -> None:
        self._about = frozenset(map(_functor, about))
        self._named = set[str]()
        self._write = write or (lambda line: print(escape_lines(line), file=sys.stderr))
        self._seen: Counter[tuple[str, ...]] = Counter()

    def listener(self, agent: str) -> Callable[[View], None]:
        """Return the ``on_decision`` of a mind with this name."""

        def print_decisions(view: View) -> None:
            for line in self._lines(agent, view):
                self._write(f"[{agent}] why: {line}")

        return print_decisions

    def _lines(self, agent: str, view: View) -> list[str]:
        if isinstance(view, FailureView):
            return [] if self._about and not self._about & set(map(_functor, view.given_up)) else failure_lines(view)
        if self._about:
            self._named.add(name := _functor(view.name))
            return decision_lines(view) if name in self._about else []
        shape = _shape(agent, view)
        self._seen[shape] += 1
        return decision_lines(view) if self._seen[shape] <= IN_FULL else []

    def finish(self) -> None:
        """Write the numbers of the decisions that were only counted, and the names that none was about."""
        for name in sorted(self._about - self._named):
            self._write(f"why: no decision was about `{name}`{did_you_mean(name, self._named)}")
        left = [(shape, count - IN_FULL) for shape, count in self._seen.most_common() if count > IN_FULL]
        for (agent, event, chosen, *_), count in left[:MOST_SUMMED_UP]:
            self._write(f"[{agent}] why: {count} more times {event}: {chosen}, for the same reasons")
        if len(left) > MOST_SUMMED_UP:
            others = sum(count for _, count in left[MOST_SUMMED_UP:])
            self._write(f"why: {others} more decisions of {len(left) - MOST_SUMMED_UP} other kinds")


def _shape(agent: str, view: DecisionView) -> tuple[str, ...]:
    """Return what decisions with the same reasons have in common."""
    rejected = [f"{r.plan.position} {r.why} {r.literal}" for r in view.rejected]
    chosen = f"the plan at {view.chosen.position}" if view.chosen is not None else "no plan"
    return (agent, f"{view.kind}{view.name}", chosen, *rejected)


def _functor(trigger: str) -> str:
    """Return the name in the text of an event: ``go`` of ``+!go(1)[source(bob)]`` and ``!go/1``."""
    return re.split(r"[(\[/]", trigger.lstrip("+-^!?~"), maxsplit=1)[0]


def decision_lines(view: DecisionView) -> list[str]:
    """Return a decision as text, a line for the event and one for each plan."""
    origin = f", from {cause_text(view.cause)}" if view.cause else ""
    if view.goal:
        origin = f", raised by the plan for {view.goal}"
    where = f" at {view.asked_at}" if view.asked_at else ""
    return [f"{view.event}{origin}{where}", *_plan_lines(view)]


def cause_text(cause: CauseView) -> str:
    """Return where an event comes from, if no plan waits for it."""
    match cause.kind:
        case "message":
            identity = f" ({cause.message})" if cause.message else ""
            return f"message {cause.performative} from {cause.sender}{identity}"
        case "told":
            return f"told by {cause.sender}"
        case "percept":
            return "a percept"
        case "program":
            return "the program"
        case "outside":
            return "given from outside"
    return f"intention {cause.intention}"


def _plan_lines(view: DecisionView) -> Iterable[str]:
    for rejected in view.rejected:
        why = rejected.message
        if rejected.why == "context":
            why = f"{rejected.literal} does not hold{_with(rejected.plan.bindings)}"
        yield f"  not {_name(rejected.plan)}: {why}"
    if view.chosen is not None:
        yield f"  chosen: {_name(view.chosen)}{_with(view.chosen.bindings)}"
        if view.untried:
            yield f"  not needed: {', '.join(map(_name, view.untried))}"
    elif view.rejected:
        yield "  no plan is applicable"
    else:
        yield f"  there is no plan for {view.kind}{view.name}"


def _name(plan: PlanView) -> str:
    label = f"@{plan.label} " if plan.label else ""
    return f"{label}{plan.trigger} ({plan.position})"


def _with(bindings: dict[str, str]) -> str:
    return f", with {', '.join(f'{name} = {value}' for name, value in bindings.items())}" if bindings else ""


def failure_lines(view: FailureView) -> list[str]:
    """Return a failure as text."""
    where = f"{view.position}: " if view.position else ""
    reason = f": {view.reason}" if view.reason else ""
    lines = [f"{where}{view.formula} fails, {view.error}{reason}"]
    if view.given_up:
        lines.append(f"  given up: {', '.join(view.given_up)}")
    lines.append(f"  goes on with {view.handled_by}" if view.handled_by else "  nothing handles it")
    return lines
