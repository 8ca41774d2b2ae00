"""Whoever follows a page, command by command, gets what it says; and the table of exceptions has no stale entry."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.boards.network import GROUND, Network
from tests.docs import table
from tests.docs.commands import commands, is_a_form
from tests.docs.pages import COMMANDS, Block, blocks, pages
from tests.docs.reader import Reader, StumbledError, shows

ALL = [
    (block, command)
    for page in pages()
    for block in blocks(page)
    if block.language in COMMANDS
    for command in commands(block)
]
FOLLOWED = sorted(
    {
        command.page
        for _, command in ALL
        if not is_a_form(command.text) and not table.entry(table.NOT_RUN, command.page, command.text)
    }
)


@pytest.fixture(scope="module")
def within(namespaces: None) -> Iterator[tuple[str, ...]]:
    with Network([]) as network:
        yield network.within(GROUND)


@pytest.mark.timeout(600)  # the tutorial flies five times
@pytest.mark.parametrize("page", FOLLOWED)
def test_a_page_can_be_followed(page: str, within: tuple[str, ...], tmp_path: Path) -> None:
    with Reader(tmp_path, within) as reader:
        reader.follow(page)


@pytest.mark.parametrize("name", ["NOT_RUN", "INSTEAD", "STAYS"])
def test_each_exception_is_of_a_command_that_is_there(name: str) -> None:
    texts = [(command.page, command.text) for _, command in ALL]
    stale = [key for key in getattr(table, name) if not any(p == key[0] and t.startswith(key[1]) for p, t in texts)]
    assert stale == []


def test_each_block_that_is_excused_is_there() -> None:
    texts = [(block.page, block.text) for page in pages() for block in blocks(page)]
    assert [
        key for key in table.NOT_WELL_FORMED if not any(p == key[0] and t.startswith(key[1]) for p, t in texts)
    ] == []


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        (["up at 3.2 s"], "up at 14.75 s\n", True),
        (["[12:00:01] up"], "[23:59:59.123] up\n", True),
        (["up", "...", "down"], "up\na\nb\ndown\n", True),
        (["up ... m"], "up at 5 m\n", True),
        (["   9.7 s  up"], "  12.7 s  up\n", True),
        (["5 m"], "6 m\n", False),
        (["up"], "up\ndown\n", False),
        ([], "up\n", False),
        ([], "", True),
    ],
)
def test_shown_and_printed_are_compared(shown: list[str], printed: str, same: bool) -> None:
    assert shows(shown, printed) is same


@pytest.mark.parametrize(
    ("text", "stumbles"),
    [
        ("$ echo one\none\n", ""),
        ("$ export A=b; cd missions\n$ echo $A; basename $PWD\nb\nmissions\n", ""),
        ("$ false\n", "exit code 1"),
        ("$ (exit 3)\n$ echo $?\n3\n", ""),
        ("$ echo one\ntwo\n", "but the page shows\ntwo"),
        ("$ argosy check missions/none.yaml\n...\n", "exit code 2"),
    ],
)
def test_a_reader_stumbles_over_what_is_not_so(
    text: str, stumbles: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.docs.reader.blocks", lambda page: [Block(page, 1, "console", "", text)])
    with Reader(tmp_path) as reader:
        if stumbles:
            with pytest.raises(StumbledError, match=stumbles):
                reader.follow("a page")
        else:
            reader.follow("a page")
