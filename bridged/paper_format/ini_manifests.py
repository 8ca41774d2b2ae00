"""From the paper's INI manifests to the model: names below `mavros/` become MAVLink, all others Zenoh keys."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TypeVar

from msgspec.structs import replace

from bridged.paper_format.mavros_names import CALLS, TOPICS, Heard, Into, below_mavros
from schemas.files.findings import Finding, Findings, did_you_mean
from schemas.files.text_files import read_text
from schemas.manifest.ini import IniAction, IniPercept, read_actions, read_percepts, value_of
from schemas.manifest.loader import ActionEntry, Field, FieldValue, Manifest, Parameter, PerceptEntry, RobotEntry, Value
from schemas.manifest.rules import default_problem

VEHICLE = "copter"
"""Of a pair with names of mavros: the paper's own; another vehicle needs the TOML form."""
FITS: Mapping[str, frozenset[str]] = {
    "float": frozenset({"float", "int"}),
    "int": frozenset({"int", "float"}),
    "boolean": frozenset({"boolean"}),
    "string": frozenset({"string"}),
    "list": frozenset({"list"}),
}
"""Which types of `params_type` a field of each type takes."""

Problem = Callable[[str, str], None]
"""Called with the option that is wrong and what is wrong with it."""
E = TypeVar("E", PerceptEntry, ActionEntry)


def load_ini_pair(actions: Path, percepts: Path) -> Manifest:
    """Read and translate an actions and a perceptions manifest. Raises Findings with what is wrong in both of them."""
    texts: list[str] = []
    findings: list[Finding] = []
    for path in (actions, percepts):
        try:
            texts.append(read_text(path))
        except Findings as found:
            findings += found.findings
    if findings:
        raise Findings(findings)
    return translate_pair(texts[0], str(actions), texts[1], str(percepts))


def translate_pair(actions: str, actions_file: str, percepts: str, percepts_file: str) -> Manifest:
    """Translate the texts of a pair; the files are what findings name. Raises Findings with every problem."""
    done, wrong_actions = read_actions(actions, actions_file)
    seen, wrong_percepts = read_percepts(percepts, percepts_file)
    findings = [*wrong_actions, *wrong_percepts]

    def problems(file: str, entry: IniAction | IniPercept) -> Problem:
        def problem(option: str, message: str) -> None:
            line = entry.lines.get(option, entry.lines[""])
            findings.append(Finding(file, line, 0, f"[{entry.name}] {option}: {message}"))

        return problem

    entries = {one.name: _percept(one, problems(percepts_file, one)) for one in seen}
    calls = {one.name: _action(one, problems(actions_file, one)) for one in done}
    if findings:
        raise Findings(findings)
    flies = "mavlink" in {entry.driver for entry in entries.values()} | {entry.driver for entry in calls.values()}
    own = "mavlink" if flies else "zenoh"
    return Manifest(
        robot=RobotEntry(driver=own, vehicle=VEHICLE if flies else "", values="text"),
        percepts={name: _of(own, entry) for name, entry in entries.items()},
        actions={name: _of(own, entry) for name, entry in calls.items()},
        file=actions_file,
        percepts_file=percepts_file,
        lines=_lines("percepts", seen, _PERCEPT_KEYS) | _lines("actions", done, _ACTION_KEYS),
    )


_PERCEPT_KEYS = {"source": "name", "args": "args", "rate": "rate", "buf": "buf"}
_ACTION_KEYS = dict.fromkeys(("command", "message", "topic", "service", "call"), "name") | {
    "params": "params_name",
    "fields": "params_name",
    "latch": "latch",
}
"""Option of the INI file for each key of the model."""


def _lines(
    table: str, entries: Iterable[IniPercept | IniAction], keys: Mapping[str, str]
) -> dict[tuple[str, ...], int]:
    lines: dict[tuple[str, ...], int] = {}
    for entry in entries:
        lines[(table, entry.name)] = entry.lines[""]
        lines |= {(table, entry.name, key): entry.lines[one] for key, one in keys.items() if one in entry.lines}
    return lines


def _of(own: str, entry: E) -> E:
    """The entry without its driver, if that is the robot's."""
    return replace(entry, driver="") if entry.driver == own else entry


def _percept(percept: IniPercept, problem: Problem) -> PerceptEntry:
    below = below_mavros(percept.topic)
    on_zenoh = PerceptEntry(driver="zenoh", source=percept.topic, args=percept.args, buf=percept.buf, rate=percept.rate)
    if below is None:
        return on_zenoh
    heard = TOPICS.get(below)
    if heard is None:
        hint = "is an action, no percept: it belongs in the actions manifest" if below in CALLS else ""
        problem("name", _unknown(below, hint, TOPICS))
        return on_zenoh
    return replace(
        heard.entry,
        driver="mavlink",
        args=tuple(_heard(below, arg, heard, "", problem) for arg in percept.args),
        buf=percept.buf,
        rate=percept.rate if heard.entry.rate is None else min(percept.rate, heard.entry.rate),
    )


def _heard(below: str, arg: str | Field, heard: Heard, inside: str, problem: Problem) -> str | Field:
    """MAVLink equivalent of a field of a mavros topic, or of the structures in one of its lists."""
    named = arg if isinstance(arg, str) else arg.field
    found = heard.fields.get(f"{inside}{named}")
    if found is None:
        known = [one.removeprefix(inside) for one in heard.fields if one.startswith(inside)]
        problem("args", f"mavros/{below} has no field `{inside}{named}` here; there is {', '.join(known)}")
        return arg
    listed = any(one.startswith(f"{inside}{named}.") for one in heard.fields)
    if listed != isinstance(arg, Field):
        expected = f"is a list of structures: `{named}[](...)`" if listed else "is no list of structures"
        problem("args", f"mavros/{below}: `{inside}{named}` {expected}")
        return arg
    if isinstance(arg, str):
        return found.field if found == Field(field=found.field) else found
    each = tuple(_heard(below, one, heard, f"{inside}{named}.", problem) for one in arg.each)
    return replace(found, each=each)


def _action(action: IniAction, problem: Problem) -> ActionEntry:
    below = below_mavros(action.target)
    if below is None:
        return _on_zenoh(action)
    taken = CALLS.get(below)
    if taken is None:
        hint = "is a percept, no action: it belongs in the perceptions manifest" if below in TOPICS else ""
        problem("name", _unknown(below, hint, CALLS))
        return _on_zenoh(action)
    if action.method != taken.method and not action.wrong:
        problem("method", f"mavros/{below} is a {taken.method}, not a {action.method}")
    fields: dict[str, Value | FieldValue] = dict(taken.entry.fields)
    params: list[Parameter] = []
    given: set[str] = set()
    for param in action.params:
        into = taken.fields.get(taken.older.get(param.name, param.name))
        if into is None:
            known = ", ".join(taken.fields) or "none"
            problem("params_name", f"mavros/{below} has no field `{param.name}` here; there is {known}")
            continue
        if action.typed and param.types[0] not in FITS[into.type]:
            problem("params_type", f"`{param.name}` of mavros/{below} is a {into.type}, not a {param.types[0]}")
        if into.field in given:
            problem("params_name", f"`{param.name}` of mavros/{below} means the same as another field here")
        params.append(_parameter(param, into, typed=action.typed))
        if wrong := default_problem(params[-1]):
            problem("defaults", f"`{param.name}` of mavros/{below}: {wrong}")
        given.add(into.field)
        fields[into.field] = into.value(param.name)
    for lacking in [name for name in taken.needed if taken.fields[name].field not in given and not action.wrong]:
        problem("params_name", f"mavros/{below} needs `{lacking}`")
    return replace(taken.entry, driver="mavlink", params=tuple(params), fields=fields)


def _parameter(param: Parameter, into: Into, *, typed: bool) -> Parameter:
    """The parameter with the range of the field that it goes into, and its type where the manifest names none."""
    param = replace(param, unit=into.unit, min=into.min, max=into.max)
    if typed:
        return param
    read = value_of(into.type, param.default) if isinstance(param.default, str) else None
    return replace(param, type=into.type, default=param.default if read is None else read)


def _on_zenoh(action: IniAction) -> ActionEntry:
    """Each parameter goes to the path of its name, as it is for Zenoh without `fields`."""
    if action.method == "topic":
        return ActionEntry(driver="zenoh", params=action.params, topic=action.target, latch=action.latch)
    return ActionEntry(driver="zenoh", params=action.params, service=action.target)


def _unknown(below: str, hint: str, known: Iterable[str]) -> str:
    return f"mavros/{below} {hint}" if hint else f"no `mavros/{below}` here{did_you_mean(below, known)}"
