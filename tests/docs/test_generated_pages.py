"""Pages that are generated are what docstrings, parsers, declarations, flights and lines of the code say."""

import re
import shlex
from collections.abc import Callable

import msgspec
import pytest

from agentd.mind.data.registry import ACTIONS, FUNCTIONS
from argosy.__main__ import COMMANDS
from schemas.wire import mind_records, vehicle_records
from schemas.wire import records as declared
from tests.agentd.minds import World, mind_of
from tests.docs import commands_page, overview_page, records_page, six_kinds_page, stdlib_page
from tests.docs.commands import complaint
from tests.docs.pages import ROOT, part_of

QUESTIONS = 15
"""Rows of the overview's table that says where something is decided."""
OVERVIEW = overview_page.PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize("made", [commands_page, records_page, stdlib_page], ids=lambda made: made.PAGE.name)
def test_a_page_is_what_it_is_made_of(made: object) -> None:
    page: Callable[[], str] = made.page  # type: ignore[attr-defined]
    assert made.PAGE.read_text(encoding="utf-8") == page(), "make reference"  # type: ignore[attr-defined]


def test_the_table_of_six_kinds_is_that_of_their_flights() -> None:
    assert part_of(six_kinds_page.PAGE, "six kinds") == six_kinds_page.block(six_kinds_page.flights())


def test_the_references_of_the_overview_are_to_files_and_lines_of_the_code() -> None:
    assert overview_page.written(OVERVIEW) == OVERVIEW, "make reference"
    named = re.findall(r"`((?:agentd|argosy|bridged|commd|schemas)(?:/\w+)+\.py)", OVERVIEW)
    assert len(named) > QUESTIONS
    assert [file for file in named if not (ROOT / file).is_file()] == []
    with pytest.raises(KeyError):
        overview_page.written("`bridged/drivers/mavlink/session.py` (`NoSuchClass`)")


def test_each_question_of_the_overview_is_answered_by_one_or_more_references() -> None:
    table = OVERVIEW.partition("## Where is it decided?")[2].partition("\n## ")[0]
    rows = [line for line in table.splitlines() if line.startswith("| ") and not line.startswith("| Question")]
    assert len(rows) >= QUESTIONS
    assert [row for row in rows if not overview_page.REFERENCE.search(row)] == []


def test_every_command_and_every_argument_is_told_in_words_and_the_example_of_each_is_taken() -> None:
    reported = list(commands_page.all_commands())
    assert {command.words[1] for command in reported if command.words[0] == "argosy"} == set(COMMANDS)
    assert [" ".join(command.words) for command in reported if not command.parser.description] == []
    assert [(command.words, one.dest) for command in reported for one in command.parser._actions if not one.help] == []
    examples = [commands_page.example_of(one) for one in reported if one.words[:2] != ("bridged", "simulate")]
    assert [one for one in examples if not one or complaint(shlex.split(one))] == []


def test_every_record_stands_on_its_page_with_every_field() -> None:
    reported = {one.name: [name for name, *_ in one.fields] for one in records_page.records()}
    every = [*vars(declared).values(), *vars(vehicle_records).values(), *vars(mind_records).values()]
    kinds = {one for one in every if isinstance(one, type) and issubclass(one, declared.Record)} - {declared.Record}
    assert reported == {one.__name__: [field.name for field in msgspec.structs.fields(one)] for one in kinds}


def test_every_internal_action_and_function_is_on_the_page_of_the_library() -> None:
    text, names = (
        stdlib_page.page(),
        {n for (n, _), f in FUNCTIONS.items() if f.__module__.startswith("agentd.stdlib.")},
    )
    names |= {n for n, made in ACTIONS.items() if made[0].function.__module__.startswith("agentd.stdlib.")}
    assert len(names) > 150
    assert [name for name in names if f"`{name}" not in text] == []


@pytest.mark.parametrize(("query", "given"), list(stdlib_page.examples()), ids=lambda text: text)
def test_an_example_of_the_library_is_true(query: str, given: str) -> None:
    names = list(dict.fromkeys(re.findall(r"\b([A-Z]\w*) = ", given)))
    shown = ", ', ', ".join(f'"{name} = ", [{name}]' for name in names).replace("'", '"') or '"holds"'
    world = World(mind_of(f"door(open). door(closed). !ask. +!ask <- for ({query}) {{ .print({shown}) }}."))
    found = [re.sub(r" = \[(.*?)\](?=, [A-Z]\w* = |$)", r" = \1", line) for line in world.settle().prints]
    assert "; ".join(found) == ("" if given == "fails" else given), world.effects
