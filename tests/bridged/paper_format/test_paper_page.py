"""docs/reference/manifests.md tells the vocabulary as it is; what it shows is what happens."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from bridged.paper_format.ini_manifests import translate_pair
from bridged.paper_format.mavros_names import CALLS, TOPICS, Heard, Taken
from schemas.files.findings import Findings
from schemas.manifest.ini import TYPES
from schemas.manifest.loader import Field

PAGE = (Path(__file__).parents[3] / "docs/reference/manifests.md").read_text(encoding="utf-8")


def percept_rows() -> Iterator[str]:
    """A row for each topic of mavros that can be perceived."""
    for name, heard in TOPICS.items():
        yield f"| `{name}` | `{heard.entry.source}` | {_fields(heard)} | {heard.note} |"


def action_rows() -> Iterator[str]:
    """A row for each topic and service of mavros by which something can be done."""
    for name, taken in CALLS.items():
        by = next(iter(taken.entry.ways().values()))
        confirmed = f"`{taken.entry.confirm}`" if taken.entry.confirm else "itself"
        said = ", ".join(_said(taken, field) for field in taken.fields) or "none"
        yield f"| `{name}` | {taken.method} | {said} | `{by}` | {confirmed} | {taken.entry.deadline} | {taken.note} |"


def _fields(heard: Heard) -> str:
    shown = []
    for name, field in heard.fields.items():
        head, _, inner = name.rpartition(".")
        if any(other.startswith(f"{name}.") for other in heard.fields):
            inside = [other.rpartition(".")[2] for other in heard.fields if other.startswith(f"{name}.")]
            shown.append(f"`{name}[]({', '.join(inside)})`")
        elif not (inner and head in heard.fields):
            shown.append(f"`{name}`{_conversion(field)}")
    return ", ".join(shown)


def _conversion(field: Field) -> str:
    return f" = `{field.field}`" + (f" × {field.scale:g}" if field.scale != 1 else "")


def _said(taken: Taken, name: str) -> str:
    into = taken.fields[name]
    bold = "**" if name in taken.needed else ""
    low = "" if into.min is None else f" {into.min:g}.." + ("" if into.max is None else f"{into.max:g}")
    return f"{bold}`{name}`{bold} {into.type}{low} {into.unit}".rstrip()


@pytest.mark.parametrize("row", [*percept_rows(), *action_rows()])
def test_every_name_of_mavros_has_its_row(row: str) -> None:
    assert row in PAGE.splitlines()


def test_no_row_tells_of_a_name_that_there_is_not() -> None:
    rows = [line for line in PAGE.splitlines() if line.startswith("| `") and line.count("|") in (5, 8)]
    assert sorted(rows) == sorted([*percept_rows(), *action_rows()])


def test_every_type_is_told() -> None:
    for name in TYPES:
        assert f"`{name}`" in PAGE


def test_the_findings_that_are_shown_are_those_that_are_told() -> None:
    actions = "[arm_motors]\nmethod = servce\nname = mavros/cmd/armin\nparams_name = value,\nparams_type = bool, int\n"
    percepts = "[state]\nname = /mavros/state\nargs = mode, conected\n"
    with pytest.raises(Findings) as found:
        translate_pair(actions, "actions_manifest", percepts, "perceptions_manifest")
    assert str(found.value) in PAGE
