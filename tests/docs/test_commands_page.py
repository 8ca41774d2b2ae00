"""docs/reference/commands.md is what the parsers say."""

from __future__ import annotations

from argosy.__main__ import COMMANDS
from tests.docs.commands_page import PAGE, all_commands, page


def test_the_page_is_what_the_parsers_say() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "make reference"


def test_every_command_and_every_argument_is_told_in_words() -> None:
    told = list(all_commands())
    assert {command.words[1] for command in told if command.words[0] == "argosy"} == set(COMMANDS)
    assert [" ".join(command.words) for command in told if not command.parser.description] == []
    silent = [(command.words, one.dest) for command in told for one in command.parser._actions if not one.help]
    assert silent == []
