"""Directives: the messages for wrong ones; included files and namespaces find one another."""

import re
from pathlib import Path

import pytest

from agentd.language.compiler.compile import DirectiveError, compile_program
from agentd.language.parse import parse_file, parse_program
from agentd.mind import Mind
from tests.agentd.check.test_check import MESSAGES
from tests.agentd.minds import World, run


def test_a_wrong_directive_is_refused_with_its_place_and_the_text_that_a_check_shows() -> None:
    shown = re.findall(
        r"^(\{.*)\n    1:1 error unknown-directive: (.*)", MESSAGES.read_text(encoding="utf-8"), re.MULTILINE
    )
    assert len(shown) > 10
    for directive, message in shown:
        with pytest.raises(DirectiveError) as refused:
            compile_program(parse_program(f"b(1).\n{directive}", "a.asl"))
        assert str(refused.value) == f"a.asl:2:1: error: {message}"


def test_a_namespace_without_a_block_is_warned_of() -> None:
    assert "has no effect" in compile_program(parse_program("{ namespace(n) } b.", "a.asl")).warnings[0]


def test_bdg_warns_that_it_does_not_try_again() -> None:
    assert any("not tried again" in line for line in run("{ begin bdg(g) } +!g <- .print(a). { end }").logs)


def test_files_include_one_another_by_paths_relative_to_themselves(tmp_path: Path) -> None:
    (tmp_path / "lib" / "deep").mkdir(parents=True)
    (tmp_path / "main.asl").write_text('{ include("lib/a.asl") } !s. +!s <- !a; !n::b; ?n::k(X); .print(X).')
    (tmp_path / "lib" / "a.asl").write_text('{ include("deep/b.asl", n) } +!a <- .print("a").')
    (tmp_path / "lib" / "deep" / "b.asl").write_text('{ include("../c.asl") } +!b <- .print("b"); ?k(X); .print(X).')
    (tmp_path / "lib" / "c.asl").write_text("k(7).")
    world = World(Mind("bob", compile_program(parse_file(tmp_path / "main.asl"), parse_file))).settle()
    assert world.prints == ["a", "b", "7", "7"]


def test_a_file_that_is_not_there_is_reported_where_it_is_included(tmp_path: Path) -> None:
    (tmp_path / "main.asl").write_text('b.\n{ include("nowhere.asl") }')
    with pytest.raises(DirectiveError) as refused:
        compile_program(parse_file(tmp_path / "main.asl"), parse_file)
    assert 'main.asl:2:1: error: cannot include "nowhere.asl"' in str(refused.value)


@pytest.mark.parametrize("declared", ["", "{ namespace(priv, local) } "])
def test_a_local_namespace_is_another_one_in_each_file(declared: str, tmp_path: Path) -> None:
    kind = "" if declared else ", local"
    part = f"{declared}{{ begin namespace(priv{kind}) }} "
    part += "k(NAME). +!ask <- ?k(X); .print(X). { end } +!go_NAME <- !priv::ask."
    (tmp_path / "a.asl").write_text(part.replace("NAME", "a"))
    (tmp_path / "b.asl").write_text(part.replace("NAME", "b"))
    (tmp_path / "main.asl").write_text(
        '{ include("a.asl") } { include("b.asl") } !s. +!s <- if (priv::k(_)) { .print(never) }; !go_a; !go_b.'
    )
    world = World(Mind("bob", compile_program(parse_file(tmp_path / "main.asl"), parse_file))).settle()
    assert world.prints == ["a", "b"]
