"""The pages say what the results say: no figure of a block was typed by hand or is older than its file."""

import re
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from benchmarks import pages, results
from benchmarks.parts import PARTS, Goal, Part


def _results(part: Part) -> tuple[results.Origin, Any]:
    return results.load(part.name, part.module().Figures)


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
def test_the_blocks_of_a_part_are_those_of_its_results(part: Part) -> None:
    origin, figures = _results(part)
    assert not origin.revision.endswith("+"), "measured with changed files: nobody else can measure that again"
    blocks = part.module().blocks(origin, figures)
    places = pages.names()
    assert blocks
    for name in blocks:
        assert name in places, f"no page has the mark <!-- figures {name} -->"
        for page in places[name]:
            text = page.read_text(encoding="utf-8")
            assert pages.filled(text, {name: blocks[name]}) == text, f"python -m benchmarks --pages {part.name}"


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
def test_the_pictures_of_a_part_are_those_of_its_results_and_shown(part: Part) -> None:
    origin, figures = _results(part)
    shown = "\n".join(page.read_text(encoding="utf-8") for page in pages.pages())
    same_tool = origin.versions.get("matplotlib") == version("matplotlib")
    for name, svg in part.pictures(figures).items():
        there = (pages.PICTURES / f"{name}.svg").read_text(encoding="utf-8")
        assert f"figures/{name}.svg" in shown, "no page shows it"
        if same_tool:  # another matplotlib draws the same otherwise
            assert alike(svg, there), f"python -m benchmarks --pages {part.name}"


def alike(svg: str, other: str) -> bool:
    """Whether two pictures show the same: another processor may round the last digit of a place otherwise."""
    marks = re.compile(r"\b[mpC_0-9a-f]*[0-9a-f]{10}\b")  # names that are made of what they name
    number = re.compile(r"(-?\d+(?:\.\d+)?(?:e-?\d+)?)")
    one, two = (number.split(marks.sub("", text)) for text in (svg, other))
    texts, places = one[::2] == two[::2], zip(one[1::2], two[1::2], strict=False)
    return len(one) == len(two) and texts and all(abs(float(a) - float(b)) < 0.01 for a, b in places)


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
def test_a_goal_that_a_part_has_missed_has_its_reason_and_what_was_tried(part: Part) -> None:
    _, figures = _results(part)
    assert silent(part.goals(figures)) == []


def silent(goals: list[Goal]) -> list[str]:
    """Return the missed goals that do not say why, and neither what was tried nor that it is not known."""
    return [
        goal.title
        for goal in goals
        if not goal.met and (len(goal.why) < 40 or not re.search(r"(?i)\btried\b|\bnot known\b", goal.why))
    ]


def test_what_is_made_of_several_parts_is_that_of_all_results() -> None:
    blocks = pages.of_several()
    places = pages.names()
    for name in blocks:
        for page in places[name]:
            text = page.read_text(encoding="utf-8")
            assert pages.filled(text, blocks) == text, "python -m benchmarks --pages"


def test_every_block_is_filled_by_a_part() -> None:
    filled = set(pages.of_several())
    for part in PARTS:
        filled |= part.module().blocks(*_results(part)).keys()
    assert pages.names().keys() == filled


def test_a_block_that_no_page_has_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text("<!-- figures here -->\nold\n<!-- end of figures -->\n")
    with pytest.raises(KeyError, match="elsewhere"):
        pages.write({"elsewhere": "1"}, tmp_path)
    assert pages.write({"here": "new"}, tmp_path) == [tmp_path / "README.md"]
    assert re.search(r"-->\n\nnew\n\n<!--", (tmp_path / "README.md").read_text())
    assert pages.write({"here": "new"}, tmp_path) == []
