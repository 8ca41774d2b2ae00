"""One file has all texts of errors, refusals, notes and findings, to be read and reviewed together."""

from __future__ import annotations

from tests.support.texts import FILE, all_texts, texts_of


def test_the_reviewed_file_has_the_texts_of_the_product() -> None:
    assert FILE.read_text(encoding="utf-8") == all_texts(), "after a review: python -m tests.support.texts"


def test_texts_are_found_where_they_are_made() -> None:
    source = """
def f(board, on):
    text = f"no board {board}" if on else "it is off now"
    raise Findings([Finding(path, 0, 0, text)])
def g(who):
    return Note("link_down", "the link is down: " + who, who)
def h(other):
    print(f"error: {other.name} does not answer")
    print("all is well")
    return Outcome(ok=False, reason=f"{other} is gone")
"""
    assert list(texts_of(source)) == [
        "Finding: no board {board}",
        "Finding: it is off now",
        "Note link_down: the link is down: {}",
        "print: error: {name} does not answer",
        "Outcome: {other} is gone",
    ]
