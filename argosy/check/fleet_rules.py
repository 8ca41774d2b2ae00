"""Mistakes of a team that are visible before it runs: receivers, presence, restarts, boards, radio links."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace

from agentd.check.symbol_table import Survey
from agentd.language.syntax_tree.errors import near
from agentd.language.syntax_tree.nodes import Goal, InternalAction, ListTerm, Operator, Program, Step, Structure
from agentd.language.syntax_tree.traversal import walk
from agentd.runtime.program_loader import restart_goal
from argosy.deploy.board_needs import outside
from argosy.processes.mavlink_links import address_of, peer_of
from argosy.processes.simulators import machine_of, vehicle_of
from bridged.drivers.mavlink.transport.address import LinkAddressError
from schemas.files.findings import Finding, Findings, did_you_mean, near_miss
from schemas.mission.access_rules import MailRights
from schemas.mission.model import Mission
from schemas.wire.keys import is_name
from schemas.wire.records import Message

ONLINE = ("online", 1)
"""The belief that `presence` gives."""
AFTER_RESTART = "restart"
"""The kind of finding that an agent does not know what to do when it is started again."""
OWN_SOURCES = ("self", "percept", "mail", "df")
"""Sources that are no agents."""
RESTARTED = ("restarted", 1)
"""The event of an agent that is started again."""
NEW_FOCUS = (Operator.ACHIEVE_NEW_FOCUS, Operator.ADD_NEW_FOCUS, Operator.DELETE_NEW_FOCUS)
"""What these begin is taken up again after a restart."""


def check_team(
    mission: Mission, surveys: Mapping[str, Survey], programs: Mapping[str, Program | None], *, restarts: bool = False
) -> list[Finding]:
    """Return warnings about what the agents expect of one another and of their restart.

    `surveys` and the composed `programs` are by agent. `restarts`: dead daemons are started again although the mission
    does not say so.
    """
    restarts = restarts or mission.restart == "on-failure" or any(board.address for board in mission.boards.values())
    created = any(call.action.name == ".create_agent" for survey in surveys.values() for call in survey.calls)
    findings: list[Finding] = []
    for agent, survey in surveys.items():
        if not created:  # any name may come to be at run time
            findings += _receivers(mission, survey)
            findings += _sources(mission, survey)
        findings += _requested_goals(surveys, survey)
        findings += _refused_mail(mission, agent, survey)
        findings += _presence(mission, agent, survey)
        findings += _restart(mission, agent, survey)
        if restarts and not _handles_restart(survey):
            asks = [other for name, other in surveys.items() if name != agent]
            findings += _after_restart(mission, agent, programs[agent], survey, asks)
    return [replace(finding, severity="warning") for finding in findings]


def check_boards(mission: Mission) -> list[Finding]:
    """Return warnings about a fleet of several machines that do not matter as long as `argosy run` is all of them."""
    findings: list[Finding] = []
    lonely = [name for name, board in mission.boards.items() if not board.address]
    if len(lonely) > 1:
        problem = f"{' and '.join(lonely)} have no `address`: their routers find one another only "
        how = "under `argosy run`" if len(lonely) == len(mission.boards) else "through those of other boards"
        findings.append(mission.positions.finding(("boards", lonely[1]), problem + how, at_key=True))
    for name, robot in mission.robots.items():
        if (link := address_of(robot)) is None or not vehicle_of(robot) or machine_of(robot) == robot.board:
            continue
        try:
            peer_of(link, mission.host_of(robot.board))
        except (LinkAddressError, ValueError) as error:
            text = f"simulated on `{machine_of(robot)}`: {error}"
            findings.append(mission.positions.finding(("robots", name, "link"), text))
    if mission.radio is not None and len({*mission.mailboxes.values()}) <= 1:
        text = "radio: has no effect: all agents and clients live on one board"
        findings.append(mission.positions.finding(("radio",), text, at_key=True))
    for name, board in mission.boards.items():
        if board.address:  # its files are to be copied there
            with suppress(Findings):  # unreadable ones are reported with the rest
                findings += [one for one in outside(mission, name) if one not in findings]
    return [replace(finding, severity="warning") for finding in findings]


def _sends(survey: Survey) -> Iterator[tuple[InternalAction, str]]:
    """Return each `.send` with the receivers whose names are written out."""
    for call in survey.calls:
        if call.action.name != ".send" or not call.action.args:
            continue
        first = call.action.args[0]
        for one in first.items if isinstance(first, ListTerm) else (first,):
            if isinstance(one, Structure) and not one.args and is_name(one.functor):
                yield call.action, one.functor


def _receivers(mission: Mission, survey: Survey) -> Iterator[Finding]:
    """Find receivers whose names are written out and who are not in the mission."""
    known = mission.mailboxes
    for action, receiver in _sends(survey):
        if receiver not in (*known, "self"):
            where = action.position
            text = f".send: nobody in the mission is called `{receiver}`{did_you_mean(receiver, known)}"
            yield Finding(where.file, where.line, where.column, text)


def _sources(mission: Mission, survey: Survey) -> Iterator[Finding]:
    """Find sources in triggers and contexts that are nearly the name of somebody in the mission."""
    for placed in survey.plans:
        for node in walk((placed.plan.trigger, placed.plan.context)):
            match node:
                case Structure("source", (Structure(source, (), position=where),)):
                    if source not in OWN_SOURCES and (hint := near_miss(source, mission.mailboxes)):
                        text = f"nobody in the mission is called `{source}`{hint}"
                        yield Finding(where.file, where.line, where.column, text)


def _requested_goals(surveys: Mapping[str, Survey], survey: Survey) -> Iterator[Finding]:
    """Find goals that are written out and sent to an agent that has no plan for them."""
    if any(other.teaches for other in surveys.values()):
        return
    for action, receiver in _sends(survey):
        match action.args:
            case (_, Structure("achieve", ()), Structure(goal, args, namespace=None), *_) if receiver in surveys:
                plans = [placed for placed in surveys[receiver].plans if placed.event in ("+!", "-!")]
                known = {placed.indicator for placed in plans}
                if surveys[receiver].open_plans or any(name is None for name, _ in known) or (goal, len(args)) in known:
                    continue
                where, hint = action.position, near(goal, {name for name, _ in known if name is not None})
                text = f".send: `{receiver}` has no plan for the goal !{goal}/{len(args)}{hint}"
                yield Finding(where.file, where.line, where.column, text)


def _refused_mail(mission: Mission, agent: str, survey: Survey) -> Iterator[Finding]:
    """Find messages whose receiver and performative are written out, and which that receiver refuses by the mission.

    The contents of a message, such as a plan for `tellHow`, are not sent by this agent.
    """
    sends = list(_sends(survey))
    sent = {id(node) for action, _ in sends for node in walk(action.args) if isinstance(node, InternalAction)}
    for action, receiver in sends:
        match action.args:
            case (_, Structure(performative, ()), *_) if receiver in mission.agents and id(action) not in sent:
                rights = MailRights(mission, receiver, mission.agents[receiver].board)
                message = Message(id="", sender=agent, performative=performative, receiver=receiver, content=0)
                if not rights.accept(message):
                    where = action.position
                    refused = f"`{receiver}` does not accept `{performative}` from `{agent}`"
                    text = f".send: {refused}; `accepts` of agent `{receiver}` in the mission can allow it"
                    yield Finding(where.file, where.line, where.column, text)


def _presence(mission: Mission, agent: str, survey: Survey) -> Iterator[Finding]:
    """Only agents with `presence: true` get `online(_)`."""
    if mission.agents[agent].presence:
        return
    added = {mention.indicator for mention in (*survey.added, *survey.sent)}
    if ONLINE in added or any(belief.literal.functor == ONLINE[0] for belief in survey.beliefs):
        return
    events = [placed.plan.trigger.literal.position for placed in survey.plans if placed.indicator == ONLINE]
    tests = [mention.position for mention in survey.tested if mention.indicator == ONLINE]
    for where in [*events, *tests][:1]:
        text = f"online/1 is only believed with `presence: true`, which agent `{agent}` has not"
        yield Finding(where.file, where.line, where.column, text)


def _restart(mission: Mission, agent: str, survey: Survey) -> Iterator[Finding]:
    """Look for the plan that the goal of `on_restart` needs."""
    try:
        goal = restart_goal(mission, agent)
    except Findings:
        return  # reported with the rest of what is composed
    if goal is None or not isinstance(goal.literal, Structure) or survey.open_plans:
        return
    wanted = (goal.literal.functor, len(goal.literal.args))
    if not any(placed.event == "+!" and placed.indicator in (wanted, (None, wanted[1])) for placed in survey.plans):
        text = f"on_restart: the program has no plan for `+!{wanted[0]}`"
        if wanted[1]:
            text = f"{text[:-1]}/{wanted[1]}`"
        text += near(wanted[0], {placed.name for placed in survey.plans if placed.event == "+!" and placed.name})
        yield mission.positions.finding(("agents", agent, "on_restart"), text)


def _handles_restart(survey: Survey) -> bool:
    """Whether the program may have a plan for `+restarted(N)`."""
    return survey.open_plans or any(
        placed.event == "+" and placed.indicator in (RESTARTED, (None, RESTARTED[1])) for placed in survey.plans
    )


def _after_restart(
    mission: Mission, agent: str, program: Program | None, survey: Survey, others: Collection[Survey]
) -> Iterator[Finding]:
    """Check that an agent that is started again knows what becomes of its robot, and has something to do."""
    declared, robot = mission.agents[agent].on_restart, mission.agents[agent].robot
    if declared != "resume":
        return
    none = "the program has no plan for `+restarted(N)`"
    text = ""
    if robot is not None and ("agents", agent, "on_restart") not in mission.positions.values:
        text = f"{none}, and the agent no `on_restart`: started again in the middle it leaves {robot} to its bridge"
    elif program is not None and _would_be_idle(program, survey, others):
        text = f"after a restart it has nothing to do: initial goals are not begun again, and {none}"
    if text:
        found = mission.positions.finding(("agents", agent), f"agents.{agent}: {text}", at_key=True)
        yield replace(found, kind=AFTER_RESTART)


def _would_be_idle(program: Program, survey: Survey, others: Collection[Survey]) -> bool:
    """Whether an agent that is started again has goals to begin with only, and nothing that makes it go on."""
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
