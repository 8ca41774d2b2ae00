"""Parameter files, and what differs between one and a vehicle.

`NAME,VALUE` of Mission Planner and MAVProxy is read and written, QGroundControl's table is read.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bridged.drivers.mavlink.actions.parameters import spellings
from bridged.drivers.mavlink.vehicle.safety_parameters import is_vehicles_own, safety_kind
from schemas.files.findings import Finding, Findings, nearest
from schemas.files.text_files import read_bounded
from schemas.humanize import columns, count, some

MAX_BYTES = 2**20
"""A vehicle has about 1,400 parameters; their table at QGroundControl has 50 kB."""
MAX_PARAMETERS = 10_000
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,15}")
"""MAVLink has room for 16 characters."""
_AUTOPILOT = "1"
"""Component id of the autopilot in QGroundControl's table: other components have parameters of their own."""
QGC_COLUMNS = 5
"""Vehicle id, component id, name, value, type."""


@dataclass(frozen=True)
class ParameterFile:
    """The parameters of a file."""

    values: dict[str, float]
    """In the order of the file."""
    of_others: int = 0
    """Rows of components other than the autopilot, which are left out."""


def read_parameter_file(path: Path) -> ParameterFile:
    """Read a parameter file. Raises Findings with every wrong line."""
    try:
        text = read_bounded(path, MAX_BYTES).decode("utf-8-sig", errors="replace")  # comments may be in any encoding
    except OSError as error:
        raise Findings.about(path, error.strerror or str(error)) from None
    values: dict[str, float] = {}
    findings: list[Finding] = []
    others = 0
    for number, line in enumerate(text.splitlines(), 1):
        line = line.partition("#")[0].strip()
        if not line:
            continue
        try:
            component, name, value = _read_line(line)
            if component != _AUTOPILOT:
                others += 1
            elif values.setdefault(name, value) != value:
                raise ValueError(f"{name} again, with another value than {values[name]:g}")
        except ValueError as error:
            findings.append(Finding(str(path), number, 0, str(error)))
    if not findings and not values:
        findings.append(Finding(str(path), 0, 0, "expected parameters: lines such as `RTL_ALT,1500`"))
    if len(values) > MAX_PARAMETERS:
        findings.append(Finding(str(path), 0, 0, f"{len(values)} parameters, expected at most {MAX_PARAMETERS}"))
    if findings:
        raise Findings(findings[:MAX_FINDINGS])
    return ParameterFile(values, others)


MAX_FINDINGS = 20


def _read_line(line: str) -> tuple[str, str, float]:
    """Return component id, name and value of a line. Raises ValueError."""
    fields = line.replace(",", " ").split()
    if len(fields) == QGC_COLUMNS and fields[0].isdigit():
        _, component, name, text, _ = fields
    elif len(fields) == 2:
        component, (name, text) = _AUTOPILOT, fields
    else:
        raise ValueError(f"expected NAME,VALUE or a row of QGroundControl's table, got `{line[:60]}`")
    if not _NAME.fullmatch(name):
        raise ValueError(f"expected the name of a parameter, of at most 16 characters, got `{name[:60]}`")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= 3.4e38:
        raise ValueError(f"{name}: expected a number, got `{text[:60]}`")
    return component, name, value


def write_parameters(values: Mapping[str, float], head: Iterable[str] = ()) -> str:
    """Return the text of a file that Mission Planner, MAVProxy and `argosy params` read; `head`: comments."""
    lines = [f"{name},{value_text(value)}" for name, value in sorted(values.items())]
    return "\n".join([*(f"# {line}" for line in head), *lines, ""])


def value_text(value: float) -> str:
    """Return the shortest text of a value that a vehicle keeps in 32 bits."""
    if value.is_integer() and abs(value) < 2**32:
        return str(int(value))
    texts = (f"{value:.{digits}g}" for digits in range(6, 10))
    return next((text for text in texts if _float32(float(text)) == _float32(value)), repr(value))


def same_value(held: float, written: float) -> bool:
    """Whether a vehicle holds what a file says: whole numbers exactly, others to the six decimals of MAVProxy."""
    if held == written or held == _float32(written):
        return True
    whole = held.is_integer() and written.is_integer()
    return not whole and math.isclose(held, written, rel_tol=1e-6, abs_tol=5e-7)


def _float32(value: float) -> float:
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.inf


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
    near: Mapping[str, str] = field(default_factory=dict)
    """For unknown ones, the vehicle's parameter of nearly the same name."""

    def text(self, robot: str) -> str:
        """Return it for people: a line for each difference, and a summary."""
        rows = [
            (one.name, value_text(one.held), "->", value_text(one.wanted), f"  safety: {one.safety}" * bool(one.safety))
            for one in self.differences
        ]
        parts = [f"{count(len(rows), 'parameter')} differ{'s' if len(rows) == 1 else ''}", f"{self.same} equal"]
        if self.unknown:
            unknown = [
                f"{name} (did you mean `{self.near[name]}`?)" if name in self.near else name for name in self.unknown
            ]
            parts.append(f"{len(unknown)} that the vehicle does not have: {some(unknown, MOST_NAMED)}")
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
    hints = {name: hint for name in unknown[:MOST_NAMED] if (hint := nearest(name, held, 0.8)) is not None}
    return Comparison(tuple(differences), tuple(unknown), own, same, len(held) - len(found), hints)
