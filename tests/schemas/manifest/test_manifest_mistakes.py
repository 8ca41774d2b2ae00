"""Every mistake in a manifest is told in its own words at its own line; the words stand in one file."""

import re
from pathlib import Path

import pytest

from bridged.drivers.registry import check_manifest
from schemas.files.findings import Findings
from schemas.manifest.loader import read_manifest

ROBOT = '[robot]\ndriver = "zenoh"\n'
BEFORE = {
    "whole": "",
    "robot": ROBOT,
    "percept": ROBOT + '[percepts.pose]\nsource = "t/pose"\n',
    "action": ROBOT + '[actions.go]\ntopic = "t/go"\n',
}
MISTAKES = Path(__file__).parents[2] / "data" / "manifest_mistakes.txt"
"""Manifests with one mistake each, and below each its findings. The first line names what of `BEFORE` comes before."""


def test_each_mistake_is_told_as_written_down_at_its_line() -> None:
    shown = []
    for block in MISTAKES.read_text(encoding="utf-8").split("\n\n"):
        name, *lines = [line for line in block.splitlines() if not re.match(r"    \d+: ", line)]
        found = problems(BEFORE[name.removesuffix(":")] + "".join(f"{line}\n" for line in lines))
        shown.append("".join(f"{line}\n" for line in (name, *lines, *(f"    {one}" for one in found))))
    assert "\n".join(shown) == MISTAKES.read_text(encoding="utf-8")


@pytest.mark.parametrize("ttl", [f'"{"9" * 400}s"', "9" * 400])
def test_a_duration_beyond_all_numbers_is_none(ttl: str) -> None:
    expected = "expected a duration such as `5s`, `500ms` or `15min`, got"
    said = ttl.strip('"')
    assert problems(f"{BEFORE['percept']}ttl = {ttl}\n") == [f"5: percepts.pose.ttl: {expected} `{said}`"]


def test_the_mistakes_of_a_whole_manifest_are_told_at_once_those_that_only_drivers_see_too() -> None:
    text = (
        '[robot]\ndriver = "zenoh"\n'
        '[percepts.altitude]\nsource = "alt"\ndriver = "zenho"\n'
        '[percepts.Battery]\nsource = "bat"\nrate = 0\n'
        '[actions.go]\nparams = [{nam = "x"}]\ndeadline = "0s"\n[orders]\nhold = "go(1)"\nland = 3\n'
    )
    assert problems(text) == [
        "5: percepts.altitude.driver: no driver `zenho`, there is mavlink, zenoh, python",
        "6: percepts.Battery: expected the name of a belief or action, such as `battery`, got `Battery`",
        "8: percepts.Battery.rate: expected a number > 0.0, got `0`",
        "9: actions.go: expected one of `command`, `message`, `topic`, `service` and `call`, got none of them",
        "10: actions.go.params[0].nam: there is no such field, did you mean `name`?",
        "10: actions.go.params[0]: needs the field `name`",
        "11: actions.go.deadline: expected more than 0 s",
        '14: orders.land: expected an action with its arguments, such as `"cmd_vel(0, 0)"`',
    ]


def problems(text: str) -> list[str]:
    """What is wrong with a manifest, as `line: message`, in the order of the lines."""
    try:
        found = check_manifest(read_manifest(text, "m.toml", check_manifest))
    except Findings as findings:
        found = findings.findings
    return [f"{one.line}: {one.message}" for one in found]
