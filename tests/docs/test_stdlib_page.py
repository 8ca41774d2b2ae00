"""docs/reference/stdlib.md is what the docstrings say, and its examples are true."""

from __future__ import annotations

import re

import pytest

from agentd.mind.data.registry import ACTIONS, FUNCTIONS
from tests.agentd.minds import World, mind_of
from tests.docs.stdlib_page import PAGE, examples, page

BELIEVED = "door(open). door(closed)."


def test_the_page_is_what_the_docstrings_say() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "make reference"


def test_every_internal_action_and_function_is_on_the_page() -> None:
    text, names = page(), {name for (name, _), f in FUNCTIONS.items() if f.__module__.startswith("agentd.stdlib.")}
    for name, actions in ACTIONS.items():
        if actions[0].function.__module__.startswith("agentd.stdlib."):
            names.add(name)
    assert len(names) > 150
    assert [name for name in names if f"`{name}" not in text] == []


@pytest.mark.parametrize(("query", "given"), list(examples()), ids=lambda text: text)
def test_an_example_is_true(query: str, given: str) -> None:
    names = list(dict.fromkeys(re.findall(r"\b([A-Z]\w*) = ", given)))
    shown = ", ', ', ".join(f'"{name} = ", [{name}]' for name in names).replace("'", '"') or '"holds"'
    world = World(mind_of(f"{BELIEVED} !ask. +!ask <- for ({query}) {{ .print({shown}) }}."))
    found = [re.sub(r" = \[(.*?)\](?=, [A-Z]\w* = |$)", r" = \1", line) for line in world.settle().prints]
    assert "; ".join(found) == ("" if given == "fails" else given), world.effects
