"""docs/reference/commands.md is what the parsers say."""

from __future__ import annotations

import shlex

from argosy.__main__ import COMMANDS
from tests.docs.commands import complaint
from tests.docs.commands_page import PAGE, all_commands, example_of, page


def test_the_page_is_what_the_parsers_say() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "make reference"


def test_every_command_and_every_argument_is_told_in_words() -> None:
    told = list(all_commands())
    assert {command.words[1] for command in told if command.words[0] == "argosy"} == set(COMMANDS)
    assert [" ".join(command.words) for command in told if not command.parser.description] == []
    silent = [(command.words, one.dest) for command in told for one in command.parser._actions if not one.help]
    assert silent == []


def test_the_example_of_each_command_is_taken_by_its_parser() -> None:
    examples = [example_of(command) for command in all_commands() if command.words[:2] != ("bridged", "simulate")]
    assert [one for one in examples if not one or complaint(shlex.split(one))] == []
