"""The page on manifests: its examples load, and its tables name every field there is."""

import re
from pathlib import Path

import msgspec
import pytest

from bridged.drivers.registry import check_manifest
from schemas.manifest.loader import read_manifest
from schemas.manifest.model import ActionEntry, Field, FieldValue, Parameter, PerceptEntry, RobotEntry
from schemas.manifest.rules import RESERVED

PAGE = (Path(__file__).parents[3] / "docs/reference/manifests.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
COPTER = '[robot]\ndriver = "mavlink"\nvehicle = "copter"\n'


def test_the_page_has_examples() -> None:
    assert len(EXAMPLES) >= 6


@pytest.mark.parametrize("text", EXAMPLES, ids=range(len(EXAMPLES)))
def test_an_example_is_a_manifest_or_a_part_of_a_copters(text: str) -> None:
    whole = text if "[robot]" in text else COPTER + text
    assert check_manifest(read_manifest(whole, "manifests.md")) == []


@pytest.mark.parametrize("kind", [RobotEntry, PerceptEntry, Field, ActionEntry, Parameter, FieldValue])
def test_every_field_has_its_row(kind: type[msgspec.Struct]) -> None:
    tables = [set(re.findall(r"`(\w+)`", "".join(row.split("|")[1] for row in table))) for table in tables_of(PAGE)]
    fields = {field.encode_name for field in msgspec.structs.fields(kind)}
    assert fields in tables


def test_the_names_of_the_bridge_are_told() -> None:
    for names in RESERVED.values():
        assert all(f"`{name}`" in PAGE for name in names)


def tables_of(page: str) -> list[list[str]]:
    """The rows of each table, without its head."""
    found: list[list[str]] = []
    for block in re.findall(r"(?:^\|.*\n)+", page, re.MULTILINE):
        found.append(block.splitlines()[2:])
    return found
