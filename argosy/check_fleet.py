"""What can be told to be wrong with a team before it runs: receivers, presence, restarts, boards, the radio."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace

from agentd.analysis.mentions import Survey
from agentd.compose import restart_goal
from agentd.language.syntax import Goal, ListTerm, Operator, Program, Step, Structure
from argosy.board_files import outside
from argosy.links import address_of, peer_of
from argosy.simulators import machine_of, vehicle_of
from bridged.drivers.mavlink.address import LinkAddressError
from schemas.endpoints import host_and_port
from schemas.findings import Finding, Findings
from schemas.mission import DEFAULT_PORT, Mission
from schemas.names import check_name
from schemas.positions import did_you_mean

ONLINE = ("online", 1)
"""The belief that `presence` gives."""
NEW_FOCUS = (Operator.ACHIEVE_NEW_FOCUS, Operator.ADD_NEW_FOCUS, Operator.DELETE_NEW_FOCUS)
"""What these begin is taken up again after a restart."""


def check_team(
    mission: Mission, surveys: Mapping[str, Survey], programs: Mapping[str, Program | None]
) -> list[Finding]:
    """Return warnings about what the agents expect of one another and of their restart.

    `surveys` and the composed `programs` are by agent.
    """
    created = any(call.action.name == ".create_agent" for survey in surveys.values() for call in survey.calls)
    findings: list[Finding] = []
    for agent, survey in surveys.items():
        if not created:  # any name may come to be at run time
            findings += _receivers(mission, survey)
        findings += _presence(mission, agent, survey)
        findings += _restart(mission, agent, survey)
        asks = [other for name, other in surveys.items() if name != agent]
        if (program := programs[agent]) is not None and _would_be_idle(mission, agent, program, survey, asks):
            text = (
                f"agents.{agent}: after a restart it has nothing to do: initial goals are not begun again, and the "
                "program has no plan for `+restarted(N)`"
            )
            findings.append(mission.positions.finding(("agents", agent), text, at_key=True))
    return [replace(finding, severity="warning") for finding in findings]


def check_boards(mission: Mission) -> list[Finding]:
    """Return warnings about a fleet of several machines that do not matter as long as `argosy run` is all of them."""
    findings: list[Finding] = []
    lonely = [name for name, board in mission.boards.items() if not board.address]
    if len(lonely) > 1:
        told = f"{' and '.join(lonely)} have no `address`: their routers find one another only "
        how = "under `argosy run`" if len(lonely) == len(mission.boards) else "through those of other boards"
        findings.append(mission.positions.finding(("boards", lonely[1]), told + how, at_key=True))
    for name, robot in mission.robots.items():
        if (link := address_of(robot)) is None or not vehicle_of(robot) or machine_of(robot) == robot.board:
            continue
        address = mission.boards[robot.board].address if robot.board in mission.boards else ""
        try:
            peer_of(link, host_and_port(address, DEFAULT_PORT)[0].strip("[]") if address else "")
        except (LinkAddressError, ValueError) as error:
            text = f"simulated on `{machine_of(robot)}`: {error}"
            findings.append(mission.positions.finding(("robots", name, "link"), text))
    if mission.radio is not None and len({*mission.mailboxes.values()}) <= 1:
        text = "radio: has no effect: all agents and clients live on one board"
        findings.append(mission.positions.finding(("radio",), text, at_key=True))
    for name, board in mission.boards.items():
        if board.address:  # its files are to be copied there
            with suppress(Findings):  # what cannot be read is told with the rest
                findings += [one for one in outside(mission, name) if one not in findings]
    return [replace(finding, severity="warning") for finding in findings]


def _receivers(mission: Mission, survey: Survey) -> Iterator[Finding]:
    """Receivers whose names are written out and who are not in the mission."""
    known = mission.mailboxes
    for call in survey.calls:
        if call.action.name != ".send" or not call.action.args:
            continue
        first = call.action.args[0]
        for one in first.items if isinstance(first, ListTerm) else (first,):
            if not isinstance(one, Structure) or one.args or one.functor in (*known, "self"):
                continue
            try:
                check_name(one.functor)
            except ValueError:
                continue
            where = call.action.position
            text = f".send: nobody in the mission is called `{one.functor}`{did_you_mean(one.functor, known)}"
            yield Finding(where.file, where.line, where.column, text)


def _presence(mission: Mission, agent: str, survey: Survey) -> Iterator[Finding]:
    """`online(_)` is told only to those who ask for it."""
    if mission.agents[agent].presence:
        return
    added = {mention.indicator for mention in (*survey.added, *survey.told)}
    if ONLINE in added or any(belief.literal.functor == ONLINE[0] for belief in survey.beliefs):
        return
    events = [placed.plan.trigger.literal.position for placed in survey.plans if placed.indicator == ONLINE]
    tests = [mention.position for mention in survey.tested if mention.indicator == ONLINE]
    for where in [*events, *tests][:1]:
        text = f"online/1 is only believed with `presence: true`, which agent `{agent}` has not"
        yield Finding(where.file, where.line, where.column, text)


def _restart(mission: Mission, agent: str, survey: Survey) -> Iterator[Finding]:
    """The goal of `on_restart` needs a plan."""
    try:
        goal = restart_goal(mission, agent)
    except Findings:
        return  # told with the rest of what is composed
    if goal is None or not isinstance(goal.literal, Structure) or survey.open_plans:
        return
    wanted = (goal.literal.functor, len(goal.literal.args))
    if not any(placed.event == "+!" and placed.indicator in (wanted, (None, wanted[1])) for placed in survey.plans):
        text = f"on_restart: the program has no plan for `+!{wanted[0]}`"
        if wanted[1]:
            text = f"{text[:-1]}/{wanted[1]}`"
        yield mission.positions.finding(("agents", agent, "on_restart"), text)


def _would_be_idle(mission: Mission, agent: str, program: Program, survey: Survey, others: Collection[Survey]) -> bool:
    """Whether an agent that is started again has goals to begin with only, and nothing that makes it go on."""
    if mission.restart != "on-failure" or mission.agents[agent].on_restart != "resume" or survey.open_plans:
        return False
    if not any(isinstance(item, Goal) for item in program.items):
        return False
    if any(isinstance(step, Step) and step.operator in NEW_FOCUS for body in survey.bodies for step in body.formulas):
        return False
    if any(other.open_wanted for other in others):
        return False
    wanted = {mention.indicator for other in others for mention in other.wanted}
    return not any(  # percepts, mail and `+restarted` raise events of beliefs
        placed.event in ("+", "-") or placed.name is None or placed.indicator in wanted for placed in survey.plans
    )
