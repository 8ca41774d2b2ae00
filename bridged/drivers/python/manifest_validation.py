"""What a manifest may say for the Python driver, and how arguments and readings pass to and from functions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from bridged.drivers.api import Value
from bridged.drivers.python.plugins import TWINS, Function, NoFunction, Plugins, has_plugin, misfit
from schemas.files.findings import Finding
from schemas.manifest.loader import ActionEntry, FieldValue, Manifest

MAX_FUNCTIONS = 32
"""Functions that a manifest may name: each has a thread of its own."""
MAX_SIZE = 10_000
"""Fields, elements or characters of a reading."""
WHOLE = "data"
"""The field of a reading that is no dict: the value itself."""
_FOREIGN = ("command", "message", "topic", "service", "frame", "confirm", "latch", "tolerance")
"""Fields of an action that other drivers have."""
_BARE = ActionEntry()
Find = Callable[[str], Function]
"""Finds a function by its name in a manifest. Raises NoFunction."""


def check_manifest(manifest: Manifest) -> Iterator[Finding]:
    """Say what is wrong with the driver's percepts and actions, each at its line."""
    real, twins = Plugins(simulated=False), Plugins(simulated=True)

    def function(name: str) -> Function:
        plugin = name.partition(".")[0]
        return (twins if has_plugin(plugin, TWINS) else real).function(name)

    yield from misfits(manifest, function)
    for name, action in manifest.actions.items():
        for field in _FOREIGN:
            if getattr(action, field) != getattr(_BARE, field):
                text = f"actions.{name}.{field}: the driver `python` has no `{field}`"
                yield manifest.finding(text, "actions", name, field)
        if action.cancel == "hold" and manifest.robot.driver == "python" and "hold" not in manifest.orders:
            text = "the driver `python` cannot hold by itself: expected `hold` in `[orders]`"
            yield manifest.finding(f"actions.{name}.cancel: {text}", "actions", name, "cancel")
        for path, said in fields_of(action).items():
            if said.table:
                text = f"actions.{name}.fields.{path}: the driver `python` has no table `{said.table}`"
                yield manifest.finding(text, "actions", name, "fields", path)
    if len(called := names(manifest)) > MAX_FUNCTIONS:
        text = f"{len(called)} functions are named, more than the {MAX_FUNCTIONS} that can have a thread each"
        yield Finding(manifest.file, 0, 0, text)


def names(manifest: Manifest) -> list[str]:
    """Return the functions that a manifest names."""
    calls = [action.call for action in manifest.actions.values()]
    return list(dict.fromkeys([*(percept.source for percept in manifest.percepts.values()), *filter(None, calls)]))


def misfits(manifest: Manifest, function: Find) -> Iterator[Finding]:
    """Say which functions there are not, and which cannot be called as the manifest does; `function` finds one."""
    for name, percept in manifest.percepts.items():
        if problem := _problem(function, percept.source, ()):
            yield manifest.finding(f"percepts.{name}.source: {problem}", "percepts", name, "source")
    for name, action in manifest.actions.items():
        if not action.call:
            said = "expected `call`, a function such as `gpio.drop`"
            yield manifest.finding(f"actions.{name}: {said}", "actions", name)
        elif problem := _problem(function, action.call, tuple(fields_of(action))):
            yield manifest.finding(f"actions.{name}.call: {problem}", "actions", name, "call")


def fields_of(entry: ActionEntry) -> dict[str, FieldValue]:
    """Return which argument of the function gets what; without `fields` each parameter is the argument of its name."""
    if not entry.fields:
        return {parameter.name: FieldValue(param=parameter.name) for parameter in entry.params}
    return {name: FieldValue.written_out(said) for name, said in entry.fields.items()}


def arguments_of(entry: ActionEntry, given: Mapping[str, Value]) -> dict[str, Value]:
    """Return the arguments of the function by name. Raises ValueError in words."""
    arguments: dict[str, Value] = {}
    for name, said in fields_of(entry).items():
        value = said.value if said.value is not None or not said.param else given[said.param]
        if (said.scale, said.offset) != (1.0, 0.0):
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"argument `{name}`: expected a number, got {value!r}")
            value = value * said.scale + said.offset
        if value is None:
            raise ValueError(f"argument `{name}`: the manifest names neither a parameter nor a value")
        arguments[name] = value
    return arguments


def fields_in(reading: object) -> Mapping[str, object] | None:
    """Return the fields of what a function returned; None, as the function said: nothing holds.

    A dict has the fields that it names, a tuple or list `0`, `1`, ... and `data`, anything else `data` alone. Raises
    ValueError for more than `MAX_SIZE`.
    """
    if isinstance(reading, str | bytes | tuple | list | Mapping) and len(reading) > MAX_SIZE:
        raise ValueError(f"a reading of {len(reading)} elements, more than {MAX_SIZE}")
    match reading:
        case None:
            return None
        case Mapping():
            return {str(name): value for name, value in reading.items()}
        case tuple() | list():
            return {**{str(index): value for index, value in enumerate(reading)}, WHOLE: list(reading)}
    return {WHOLE: reading}


def _problem(function: Find, name: str, arguments: tuple[str, ...]) -> str:
    try:
        problem = misfit(function(name), arguments)
    except NoFunction as error:
        return str(error)
    given = ", ".join(arguments) or "nothing"
    return f"`{name}` is to be called with {given}: {problem}" if problem else ""
