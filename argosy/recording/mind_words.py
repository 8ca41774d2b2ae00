"""What came of living a mind again, in words: how far two lives agree, and where they part."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from agentd.replaying import Act, Difference, Result
from agentd.why import decision_lines
from schemas.minds import DecisionView

SHOWN = 5
"""Acts that are shown of what each life did next, and inputs of what came in before."""
LONGEST = 200
"""Characters of a line; what programs print may be long."""


def figures(result: Result, wall: float) -> str:
    """Return how far two lives agree, in figures."""
    counts = (
        (result.cycles, "cycle"),
        (result.inputs, "input"),
        (result.decisions, "decision"),
        (result.effects, "effect"),
    )
    told = ", ".join(f"{count} {name}{'' if count == 1 else 's'}" for count, name in counts)
    return f"{told} up to {result.until:.1f} s of mission time, lived again in {wall:.1f} s"


def difference_lines(difference: Difference, edited: bool, shown: int = SHOWN) -> Iterator[str]:
    """Tell where two lives part. `edited`: the other program was changed on purpose."""
    where = f"at {difference.time:.3f} s of mission time, in cycle {difference.cycle}"
    if not difference.exact:
        where = f"somewhere up to {difference.time:.3f} s of mission time, cycle {difference.cycle}"
    yield f"first difference {where} (batch {difference.batch} of its inputs)"
    if inputs := difference.inputs[-shown:] if shown else ():
        yield "  what came in last before it:"
        yield from (f"    {_short(line)}" for line in inputs)
    was, now = ("recorded", "edited") if edited else ("recorded", "replayed")
    yield from _act_lines(f"the {was} program", difference.recorded)
    yield from _act_lines(f"the {now} program" if edited else "lived again it", difference.replayed)
    for name, acts in ((was, difference.recorded_next), (now, difference.replayed_next)):
        if acts and shown:
            yield f"  what the {name} one did next:"
            yield from (f"    {act_line(act)}" for act in acts[:shown])


def act_line(act: Act) -> str:
    """Return a decision or an effect as one line."""
    what = f"{act.text}" if act.kind == "effect" else f"decided {act.text}"
    return _short(f"{act.time:9.3f} s  {what}")


def _act_lines(who: str, act: Act | None) -> Iterator[str]:
    if act is None:
        yield f"  {who}: nothing that is known of"
        return
    yield f"  {who}:"
    yield f"  {act_line(act)}"
    if act.decision is not None:
        yield from (f"    {line}" for line in words(act.decision))


def words(decision: DecisionView) -> Iterable[str]:
    """Return a decision as `agentd run --why` tells it: the event, each plan and why it was not chosen."""
    return (_short(line.removeprefix("why: ")) for line in decision_lines(decision))  # type: ignore[arg-type]


def _short(text: str) -> str:
    one = " ".join(text.splitlines()) if "\n" in text else text
    return one if len(one) <= LONGEST else f"{one[: LONGEST - 1]}…"
