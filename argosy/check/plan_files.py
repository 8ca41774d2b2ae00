"""Plan files of ground stations that programs and manifests name: read here as the bridge will read them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from agentd.check.finding_kinds import Kind, finding
from agentd.check.symbol_table import Survey
from agentd.language.syntax_tree.nodes import Position, String, Structure
from bridged.drivers.argument_check import fields_of
from bridged.drivers.mavlink.actions.mission_items import ABOVE_HOME
from bridged.drivers.mavlink.plan_files import BadPlan, PlanFile, find_plan, read_plan
from schemas.files.findings import Finding
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.mission.model import Limits

CALL, FIELD = "plan_upload", "file"
"""The call of the MAVLink driver that takes a plan file, and its field."""


@dataclass(frozen=True)
class NamedPlan:
    """A plan file whose name is written out in a program, or in the manifest for an action of the program."""

    action: str
    name: str
    where: Position


def named_plans(survey: Survey, manifest: Manifest) -> Iterator[NamedPlan]:
    """Yield the plan files that a program names for its robot; names that only the run knows are left out."""
    for mention in survey.actions:
        entry = manifest.actions.get(mention.name)
        if entry is None or entry.call != CALL or manifest.driver_of(entry) != "mavlink":
            continue
        match _name(entry, mention.literal):
            case str() as name:
                yield NamedPlan(mention.name, name, mention.position)


def _name(entry: ActionEntry, action: Structure) -> str | None:
    field = fields_of(entry).get(FIELD)
    if field is None or isinstance(field.value, str):
        return None if field is None else str(field.value)
    names = [parameter.name for parameter in entry.params]
    index = names.index(field.param) if field.param in names else len(action.args)
    match action.args[index : index + 1]:
        case (String(value),):
            return value
    return None


def check_plans(survey: Survey, manifest: Manifest, folder: Path, limits: Limits) -> list[Finding]:
    """Return what the bridge would refuse of the plan files that a program names, and what it would not take."""
    findings: list[Finding] = []
    for plan in named_plans(survey, manifest):
        try:
            read = read_plan(find_plan(folder, plan.name), plan.name)
            if problem := _too_high(read, limits):
                raise BadPlan(f"{plan.name}: {problem}")
        except BadPlan as error:
            findings.append(finding(Kind.ACTION_TYPE, plan.where, f"the action {plan.action}: {error}"))
            continue
        if read.remark:
            text = f"the action {plan.action}: {plan.name}: {read.remark}"
            findings.append(finding(Kind.ACTION_TYPE, plan.where, text, "warning"))
    return findings


def _too_high(plan: PlanFile, limits: Limits) -> str:
    """Return which item is above the mission's limit, as far as that is known before home is; empty = none."""
    for seq, item in enumerate(plan.items, 1):
        if limits.altitude is None or not item.flown:
            continue
        if item.above_terrain:
            return f"item {seq}: an altitude above terrain cannot be compared with the mission's limit"
        if item.frame in ABOVE_HOME and item.z > limits.altitude:
            return f"item {seq}: altitude {item.z:g} m is above the mission's limit of {limits.altitude:g} m"
    return ""
