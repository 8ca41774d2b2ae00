"""Every block of every page is of a known kind and well-formed, and every command line of ours parses."""

import configparser
import json
import re
import tomllib

import pytest
import yaml
import zenoh

from agentd.jason_project.project_parser import parse_project
from agentd.language.parse import parse_program
from tests.docs.commands import calls, complaint, mentions
from tests.docs.pages import LANGUAGES, Block, blocks, pages, without_blocks
from tests.docs.table import NOT_WELL_FORMED, entry

ALL = [block for page in pages() for block in blocks(page)]
INDENTED = re.compile(r"^(?:(?!\s*(?:[-*+]|\d+[.)]|\|)\s)\S.*)?\n\n( {4,}\S.*)$", re.MULTILINE)
"""A line indented like code after a paragraph that is not an item of a list."""


@pytest.mark.parametrize("page", pages())
def test_every_block_says_of_what_kind_it_is(page: str) -> None:
    strange = [f"{block.where}: ```{block.language}" for block in blocks(page) if block.language not in LANGUAGES]
    assert not strange, f"a block is one of {', '.join(sorted(LANGUAGES))}"


@pytest.mark.parametrize("page", pages())
def test_code_stands_in_fences(page: str) -> None:
    assert [match[1] for match in INDENTED.finditer(without_blocks(page))] == []


@pytest.mark.parametrize("block", ALL, ids=lambda block: block.where)
def test_a_block_is_well_formed(block: Block) -> None:
    if why := entry(NOT_WELL_FORMED, block.page, block.text):
        pytest.skip(why)
    match block.language:
        case "asl":
            parse_program(block.text, block.where)
        case "mas2j":
            parse_project(block.text, block.where)
        case "python":
            compile(block.text, block.where, "exec")
        case "toml":
            tomllib.loads(block.text)
        case "yaml":
            assert yaml.safe_load(block.text) is not None
        case "json":
            json.loads(block.text)
        case "json5":
            zenoh.Config.from_json5(block.text)
        case "ini":
            configparser.ConfigParser(interpolation=None).read_string(block.text)
        case "diff":
            assert block.title, 'a diff says by title="FILE" what it changes'


@pytest.mark.parametrize("page", pages())
def test_every_command_line_of_ours_is_one_that_its_parser_takes(page: str) -> None:
    wrong = []
    for command in mentions(page):
        for call in calls(command.text):
            if printed := complaint(call, command.in_prose):
                wrong.append(f"{command.where}: {' '.join(call)}: {printed}")
    assert wrong == []


@pytest.mark.parametrize(
    "call",
    ["argosy run m.yaml --sped 3", "argosy fly m.yaml", "bridged serve", "commd serve M --speed X", "agentd run"],
)
def test_a_misspelt_command_line_is_found(call: str) -> None:
    assert complaint(call.split()) != ""
