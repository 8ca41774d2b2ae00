"""What must be said above everything else: no router, nobody there, the view is paused."""

from __future__ import annotations

from rich.text import Text

from argosy.fleet_model import TeamModel
from argosy.watch.fleet_link import Link
from argosy.watch.row_text import BAD, GOOD, WARN, clock, joined, said
from schemas.humanize import count, span

HINT_AFTER = 10.0
"""Seconds of waiting after which it is said what the reason may be."""


def title(model: TeamModel, router: str) -> Text:
    """Return which fleet it is and how many of it are there."""
    there = [
        f"{sum(one.there for one in members.values())} of {count(len(members), what)}"
        for members, what in ((model.agents, "agent"), (model.robots, "robot"), (model.boards, "board"))
        if members
    ]
    others = f"also at this router: {', '.join(sorted(model.other_fleets))}" if model.other_fleets else ""
    return joined(
        (f"argosy watch {model.fleet or 'any fleet'}", "bold"),
        *there,
        (others, WARN),
        (_run(model), "dim"),
        (router, "dim"),
    )


def banner(link: Link, model: TeamModel, paused: bool) -> list[Text]:
    """Return what is wrong with what is shown, a line for each; none if nothing is."""
    now, lines = link.model.now(), list[Text]()
    live = link.model
    if link.failure:
        lines.append(said(link.failure, BAD))
    elif live.over:
        lines += _ended(live)
    elif not link.reached:
        why = link.problem or f"dialling {link.place.router}"
        lines.append(said(f"no router yet, waiting for {span(now - link.since)}: {why}", BAD))
        if now - link.since > HINT_AFTER:
            lines.append(
                said("is the fleet running? is it another router: --router ENDPOINT, or --mission FILE?", WARN)
            )
    elif not live.router_up:
        lost = now - (live.router_since or now)
        lines.append(
            said(f"ROUTER LOST for {span(lost)}: all below is as it was; it comes back by itself", "reverse bold red")
        )
    elif not any(one.there for members in (live.agents, live.robots, live.boards) for one in members.values()):
        who = f"nobody of fleet {live.fleet}" if live.fleet else "nobody"
        lines.append(said(f"{who} is there yet, waiting for {span(now - link.since)}", WARN))
        if now - link.since > HINT_AFTER:
            others = (
                f"at this router there is {', '.join(sorted(live.other_fleets))}: --fleet NAME; "
                if live.other_fleets
                else ""
            )
            lines.append(said(f"{others}is it started (argosy run, or its units)? argosy doctor tells more", WARN))
    if live.run_silent is not None:
        lines.append(said(f"argosy run is not heard for {span(live.run_silent)}: nobody watches over this run", WARN))
    if paused:
        text = f"PAUSED as it was at {clock(model.now())}: the fleet goes on without you; space to go on"
        lines.append(said(text, "reverse yellow"))
    return lines


def _run(model: TeamModel) -> str:
    """Return the mission time and the phase of the run; the time of day while no mission time is known."""
    seconds = model.clock.seconds(model.as_of)
    time = f"{clock(model.now())} (wall)" if seconds is None else f"{seconds:.0f} s of mission"
    return time if model.run_state is None else f"{model.run_state.phase.replace('_', ' ')}, {time}"


def _ended(model: TeamModel) -> list[Text]:
    """Return how the run has ended, and where its report and its recording are."""
    state = model.run_state
    assert state is not None
    after = f"after {state.mission_time:.1f} s"
    words = f"the mission is done {after}" if state.phase == "done" else f"the mission has failed {after}: {state.why}"
    kept = [f"{what}: {place}" for what, place in (("report", state.report), ("recording", state.recording)) if place]
    return [said(words, GOOD if state.phase == "done" else BAD), *(said(line) for line in kept)]
