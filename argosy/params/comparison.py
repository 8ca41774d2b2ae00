"""What a parameter file and a vehicle differ in, and what of it may be set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from argosy.params.param_files import same_value, value_text
from bridged.drivers.mavlink.actions.parameters import spellings
from bridged.drivers.mavlink.vehicle.safety_parameters import is_vehicles_own, safety_kind
from schemas.humanize import columns, count, joined

MOST_NAMED = 20
"""Parameters that one line names."""


@dataclass(frozen=True)
class Difference:
    """A parameter whose value in the file is not that of the vehicle."""

    name: str
    """As the file has it."""
    held: float
    """The vehicle's value."""
    wanted: float
    """The file's value."""

    @property
    def safety(self) -> str:
        """What of the vehicle's safety it belongs to; empty if it belongs to nothing."""
        return safety_kind(self.name)


@dataclass(frozen=True)
class Comparison:
    """A parameter file beside the parameters of a vehicle."""

    differences: tuple[Difference, ...]
    unknown: tuple[str, ...]
    """In the file, and not in the vehicle."""
    own: int
    """Those of the file that the vehicle changes by itself: they are not compared."""
    same: int
    not_in_file: int

    def text(self, robot: str) -> str:
        """Return it for people: a line for each difference, and a summary."""
        rows = [
            (one.name, value_text(one.held), "->", value_text(one.wanted), f"  safety: {one.safety}" * bool(one.safety))
            for one in self.differences
        ]
        parts = [f"{count(len(rows), 'parameter')} differ{'s' if len(rows) == 1 else ''}", f"{self.same} equal"]
        if self.unknown:
            parts.append(f"{len(self.unknown)} that the vehicle does not have: {some(self.unknown)}")
        if self.own:
            parts.append(f"{self.own} that the vehicle changes by itself, not compared")
        parts.append(f"{self.not_in_file} of the vehicle that the file does not have")
        return "\n".join([*(columns(rows, {1}) if rows else ()), f"{robot}: {'; '.join(parts)}"])


def compare(wanted: Mapping[str, float], held: Mapping[str, float]) -> Comparison:
    """Compare the values of a file with those of a vehicle, renamed parameters by either name."""
    differences, unknown, own, found = list[Difference](), list[str](), 0, set[str]()
    for name, value in wanted.items():
        theirs = next((one for one in spellings(name) if one in held), None)
        if theirs is None:
            unknown.append(name)
            continue
        found.add(theirs)
        if is_vehicles_own(theirs):
            own += 1
        elif not same_value(held[theirs], value):
            differences.append(Difference(name, held[theirs], value))
    same = len(found) - own - len(differences)
    return Comparison(tuple(differences), tuple(unknown), own, same, len(held) - len(found))


def some(names: Sequence[str]) -> str:
    """Return the first of some names, and how many more there are."""
    more = [f"{len(names) - MOST_NAMED} more"] if len(names) > MOST_NAMED else []
    return joined([*names[:MOST_NAMED], *more])
