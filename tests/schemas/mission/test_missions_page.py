"""The page on the mission file: its examples load, and its tables name every field there is, with its default."""

import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from schemas.files.units import Duration
from schemas.mission.model import (
    Agent,
    Board,
    Client,
    Failsafe,
    FileModel,
    Gateway,
    Ids,
    Lease,
    Limits,
    MailRules,
    MissionFile,
    Radio,
    Robot,
    Router,
    Security,
    Signing,
    Simulate,
    World,
    read_mission,
)

PAGE = (Path(__file__).parents[3] / "docs/reference/missions.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
MODELS = {
    "The file": MissionFile,
    "`boards`": Board,
    "`agents`": Agent,
    "`robots`": Robot,
    "`ids`": Ids,
    "`signing`": Signing,
    "`lease`": Lease,
    "`failsafe`": Failsafe,
    "`limits`": Limits,
    "`simulate`": Simulate,
    "`router`": Router,
    "`clients`": Client,
    "`gateway`": Gateway,
    "`mail`": MailRules,
    "`radio`": Radio,
    "`world`": World,
    "`security`": Security,
}


@pytest.mark.parametrize("text", EXAMPLES, ids=range(len(EXAMPLES)))
def test_an_example_is_a_mission(text: str) -> None:
    assert read_mission(text, Path("missions.md")).agents


@pytest.mark.parametrize("heading", MODELS)
def test_a_table_names_exactly_the_fields_and_their_defaults(heading: str) -> None:
    section = re.split(r"^#+ ", PAGE.partition(f"# {heading}\n")[2], maxsplit=1, flags=re.MULTILINE)[0]
    rows = [[cell.strip() for cell in line.split("|")[1:4]] for line in section.splitlines() if line.startswith("| `")]
    fields = msgspec.structs.fields(MODELS[heading])
    assert [(name, default) for name, _, default in rows] == [(f"`{f.name}`", default_of(f)) for f in fields]


@pytest.mark.parametrize("model", MODELS.values())
def test_the_long_example_has_every_field(model: type[FileModel]) -> None:
    names = {field.name for field in msgspec.structs.fields(model)}
    assert names <= keys_of(yaml.safe_load(EXAMPLES[-1]))


def default_of(field: msgspec.structs.FieldInfo) -> str:
    """A default as the page writes it."""
    if field.required:
        return "needed"
    value = field.default_factory() if field.default is msgspec.NODEFAULT else field.default
    match value:
        case None | "":
            return "none"
        case Duration():
            return f"`{value}`"
        case bool():
            return f"`{str(value).lower()}`"
        case msgspec.Struct():
            return "`{}`"
        case tuple():
            return f"`[{', '.join(value)}]`"
    return f"`{value}`"


def keys_of(value: Any) -> set[str]:
    """All keys at any depth."""
    if not isinstance(value, dict):
        return set()
    return set(value).union(*map(keys_of, value.values()))
