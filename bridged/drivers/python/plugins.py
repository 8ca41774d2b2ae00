"""Plug-ins: installed modules whose functions a manifest may name, as `PLUGIN.FUNCTION`.

An installed package declares a plug-in by an entry point of the group `argosy.python`, and its simulated twin by one of
the same name in `argosy.python.simulated`. Of a module only what it lists in `__all__` can be named.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any

from bridged.drivers.api import Value
from bridged.drivers.argument_check import fields_of, filled
from bridged.drivers.registry import load
from schemas.files.findings import Finding
from schemas.manifest.loader import ActionEntry, Manifest

REAL, TWINS = "argosy.python", "argosy.python.simulated"
"""Groups of entry points."""

Function = Callable[..., Any]


class NoFunction(ValueError):
    """There is no such plug-in or function, or it cannot be loaded; the text names those that there are."""


@dataclass(frozen=True)
class Plugin:
    """A plug-in that was imported."""

    name: str
    functions: Mapping[str, Function]
    """Its functions."""


class Plugins:
    """The plug-ins of this Python environment, imported when they are asked for."""

    def __init__(self, *, simulated: bool) -> None:
        """`simulated`: the twins."""
        self.simulated = simulated
        self._loaded: dict[str, Plugin | NoFunction] = {}

    def function(self, name: str) -> Function:
        """Return what `PLUGIN.FUNCTION` names. Raises NoFunction."""
        plugin, _, function = name.rpartition(".")
        if not plugin or not function or "." in plugin:
            raise NoFunction(f"expected PLUGIN.FUNCTION, such as `gpio.sonar`, got `{name}`")
        found = self._plugin(plugin).functions
        if function not in found:
            known = ", ".join(found) or "nothing"
            twin = "the twin of the plug-in" if self.simulated else "the plug-in"
            raise NoFunction(f"{twin} `{plugin}` offers no `{function}`; in its `__all__` there is {known}")
        return found[function]

    def _plugin(self, name: str) -> Plugin:
        if name not in self._loaded:
            try:
                self._loaded[name] = self._load(name)
            except NoFunction as error:
                self._loaded[name] = error
        found = self._loaded[name]
        if isinstance(found, NoFunction):
            raise found
        return found

    def _load(self, name: str) -> Plugin:
        group = TWINS if self.simulated else REAL
        found = entry_points(group=group)
        for entry in found.select(name=name):
            return Plugin(name, _offered(entry))
        if self.simulated and has_plugin(name):
            raise NoFunction(f"the plug-in `{name}` cannot be simulated: no entry point of `{TWINS}` has its name")
        known = ", ".join(sorted({entry.name for entry in found})) or "none"
        raise NoFunction(f"no plug-in `{name}` is installed (entry points of `{group}`); there is {known}")


def has_plugin(name: str, group: str = REAL) -> bool:
    """Whether an installed package declares a plug-in."""
    return bool(entry_points(group=group).select(name=name))


def _offered(entry: EntryPoint) -> dict[str, Function]:
    """Import the module of an entry point and return its functions. Raises NoFunction."""
    origin = "" if entry.dist is None else f" of {entry.dist.name} {entry.dist.version}"
    try:
        module = load(entry)
    except (Exception, SystemExit) as error:  # whatever a package does when it is imported
        what = f"{type(error).__name__}: {error}"
        raise NoFunction(f"the plug-in `{entry.name}`{origin} cannot be imported: {what}") from None
    if not isinstance(module, ModuleType):
        raise NoFunction(f"the plug-in `{entry.name}`{origin}: `{entry.value}` is no module")
    listed = getattr(module, "__all__", ())
    return {name: value for name in listed if callable(value := getattr(module, name, None))}


def misfit(function: Function, arguments: Iterable[str]) -> str:
    """Return why a function cannot be called with arguments of these names; empty if it can."""
    if inspect.iscoroutinefunction(function) or inspect.isasyncgenfunction(function):
        return "it is `async`; plain functions and generators are called, each in a thread of its own"
    try:
        signature = inspect.signature(function)
    except ValueError:  # some functions of extension modules do not tell
        return ""
    try:
        signature.bind(**dict.fromkeys(arguments))
    except TypeError as error:
        return f"{error}: it is {getattr(function, '__name__', 'called')}{signature}"
    return ""


MAX_SIZE = 10_000
"""Fields, elements or characters of a reading."""
WHOLE = "data"
"""The field of a reading that is no dict: the value itself."""
Find = Callable[[str], Function]
"""Finds a function by its name in a manifest. Raises NoFunction."""


def names(manifest: Manifest) -> list[str]:
    """Return the functions that a manifest names."""
    calls = [action.call for action in manifest.actions.values()]
    return list(dict.fromkeys([*(percept.source for percept in manifest.percepts.values()), *filter(None, calls)]))


def misfits(manifest: Manifest, function: Find) -> Iterator[Finding]:
    """Yield functions that are missing or cannot be called as the manifest does; `function` finds one."""
    for name, percept in manifest.percepts.items():
        if problem := _problem(function, percept.source, ()):
            yield manifest.finding(f"percepts.{name}.source: {problem}", "percepts", name, "source")
    for name, action in manifest.actions.items():
        if not action.call:
            expected = "expected `call`, a function such as `gpio.drop`"
            yield manifest.finding(f"actions.{name}: {expected}", "actions", name)
        elif problem := _problem(function, action.call, tuple(fields_of(action))):
            yield manifest.finding(f"actions.{name}.call: {problem}", "actions", name, "call")


def arguments_of(entry: ActionEntry, given: Mapping[str, Value]) -> dict[str, Value]:
    """Return the arguments of the function by name. Raises ValueError."""
    arguments: dict[str, Value] = {}
    for name, declared in fields_of(entry).items():
        arguments[name] = value = filled(f"argument `{name}`", declared, given)
        if value is None:
            raise ValueError(f"argument `{name}`: the manifest names neither a parameter nor a value")
    return arguments


def fields_in(reading: object) -> Mapping[str, object] | None:
    """Return the fields of a function's result; None = nothing holds.

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
