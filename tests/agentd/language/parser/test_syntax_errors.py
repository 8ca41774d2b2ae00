"""What the parser refuses, where, and in which words."""

from pathlib import Path

import pytest

from agentd.language.errors.error_context import ErrorContext
from agentd.language.errors.explain import Row, rows
from agentd.language.parse import MOST_PROBLEMS, parse_file, parse_program, parse_term
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.printer import source_text
from tests.agentd.mistakes import mistakes

CORPUS = Path(__file__).parents[3] / "conformance" / "syntax_errors"
REFUSED = sorted(CORPUS.glob("*.asl"))
MISTAKES = mistakes("mistakes.txt")
"""Mistakes that beginners make, and users of other languages."""


def errors_of(text: str) -> SyntaxErrors:
    with pytest.raises(SyntaxErrors) as caught:
        parse_program(text, "a.asl")
    return caught.value


def test_the_corpus_is_there() -> None:
    assert len(REFUSED) >= 40


@pytest.mark.parametrize("path", REFUSED, ids=lambda path: path.stem)
def test_a_program_of_the_corpus_is_refused_once_at_its_line(path: Path) -> None:
    expected = path.with_suffix(".err").read_text(encoding="utf-8").splitlines()[0]
    line, column = expected.split(":")
    with pytest.raises(SyntaxErrors) as caught:
        parse_file(path)
    (finding,) = caught.value.findings
    assert (finding.file, finding.line) == (str(path), int(line))
    if column != "?":
        assert abs(finding.column - int(column)) <= 4
    assert "is not allowed here" not in finding.message, "the corpus' mistakes have messages of their own"


@pytest.mark.parametrize(("text", "place", "message"), MISTAKES, ids=[text for text, _, _ in MISTAKES])
def test_a_mistake_is_reported_once_with_its_place_and_what_to_write(text: str, place: str, message: str) -> None:
    (finding,) = errors_of(text).findings
    assert f"{finding.line}:{finding.column}" == place
    assert finding.message == message


def test_each_row_of_the_table_gives_the_message_of_a_mistake(monkeypatch: pytest.MonkeyPatch) -> None:
    used: list[Row] = []
    fits = Row.fits

    def noted(row: Row, error: ErrorContext) -> list[int] | None:
        found = fits(row, error)
        if found is not None:
            used.append(row)  # the first row that fits gives the message; rows for foreign signs may pass
        return found

    monkeypatch.setattr(Row, "fits", noted)
    for text, _, _ in MISTAKES:
        errors_of(text)
    assert [row.text for row in rows() if row not in used] == []


BETWEEN = [
    (text, int(place.split(":")[0]))
    for text, place, message in MISTAKES
    if text.endswith(".") and not text.startswith("{ begin") and "not closed in its line" not in message
]


@pytest.mark.parametrize(("text", "line"), BETWEEN, ids=[text for text, _ in BETWEEN])
def test_a_mistake_among_others_hides_none_of_them_and_raises_no_false_ones(text: str, line: int) -> None:
    program = f"""ok(1).
+!first <- a b.
+!fine : ok(X) <- .print(X).
{text}
+!second(X) : a, b <- c.
@fine +!good <- d.
fact(1).
+!third <- !x y.
"""
    length = text.count("\n") + 1
    assert [f.line for f in errors_of(program).findings] == [2, 3 + line, 4 + length, 7 + length]


def test_an_error_shows_its_place_its_line_and_a_caret() -> None:
    assert str(errors_of('!start.\n\t+!start <- .print("a"), b.')) == (
        "a.asl:2:24: error: body formulas are separated by ; and not by a comma\n"
        '     +!start <- .print("a"), b.\n'
        "                           ^"
    )


def test_of_a_very_long_line_only_the_part_around_the_error_is_shown() -> None:
    _, excerpt, caret = str(errors_of("+!g <- " + "a; " * 500 + "b c; " + "d; " * 500 + "e.")).splitlines()
    assert len(excerpt) < 130
    assert excerpt.startswith("    ...")
    assert excerpt.endswith("...")
    assert excerpt[caret.index("^")] == "c"


def test_errors_of_several_plans_are_reported_in_one_run() -> None:
    text = """!start : now.
+!a <- b c.
+!d <- e.
+!f <- X = .
+!g <- "unclosed.
+!h <- i.
+!j <- .print(1)
+!k <- l m.
n(.
"""
    assert [finding.line for finding in errors_of(text).findings] == [1, 2, 4, 6, 8, 9]


def test_after_an_error_among_sub_plans_their_brace_is_no_further_error() -> None:
    assert [finding.line for finding in errors_of("+!a <- b. {\n +!c <- d e.\n +!f <- g.\n}\n+!h.").findings] == [2]


def test_no_more_errors_are_reported_than_are_read() -> None:
    assert len(errors_of("+!g <- a b.\n" * 100).findings) == MOST_PROBLEMS


def test_an_error_in_a_single_term_stops_there() -> None:
    with pytest.raises(SyntaxErrors) as caught:
        parse_term("f(1, ")
    assert [(f.file, f.line) for f in caught.value.findings] == [("<term>", 1)]


@pytest.mark.parametrize("directive", ['register_function("twice", 1, "double")', 'include("functions.asl")'])
def test_a_registered_function_is_an_operand_and_after_an_include_any_structure_may_be_one(directive: str) -> None:
    program = f"{{ {directive} }} +!g <- X = twice(1) + 1."
    assert source_text(parse_program(program, "a.asl").items[1]) == "+!g <- (X = (twice(1)+1))."


def test_a_file_that_is_not_utf8_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "latin.asl"
    path.write_bytes(b'b(1).\nc("caf\xe9").\n')
    with pytest.raises(SyntaxErrors, match=r"latin.asl:2: error: byte 12 of the file \(0xe9\) is not UTF-8"):
        parse_file(path)


def test_a_file_that_an_editor_saved_as_utf16_is_reported_as_such(tmp_path: Path) -> None:
    path = tmp_path / "wide.asl"
    path.write_bytes("b(1).".encode("utf-16"))
    with pytest.raises(SyntaxErrors, match=r"wide.asl:1: error: the file is UTF-16 text; save it as UTF-8"):
        parse_file(path)


def test_a_byte_order_mark_is_no_error(tmp_path: Path) -> None:
    path = tmp_path / "mark.asl"
    path.write_bytes(b"\xef\xbb\xbfb(1).\r\n!g.\r\n")
    assert len(parse_file(path).items) == 2


@pytest.mark.parametrize(
    "text",
    [
        "+!g <- X = 1 + LONG.",
        "+!g <- X = 1 + LONG(1).",
        "+!g <- +.LONG.",
        "+!g <- ?.LONG.",
        "{ LONG LONG }",
        "{ begin LONG }",
        "b(1 LONG).",
        'b(1 "LONG").',
        "LONG LONG.",
        "b(1LONG).",
    ],
)
def test_a_message_stays_short_whatever_the_names(text: str) -> None:
    (finding,) = errors_of(text.replace("LONG", "long" * 1000)).findings
    assert len(finding.message) < 300
