"""The mind on docs/reference/records.md: its example is what an agent publishes, its tables name every kind."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec

from agentd.trace.input_records import KINDS, UNWRITTEN
from schemas.wire import mind_records
from tests.agentd.mind_format_page import PAGE, example, script, shown, steady
from tests.docs.pages import part_of


def test_the_example_is_what_an_agent_says_and_the_script_reads_it(tmp_path: Path, endpoint: str) -> None:
    (tmp_path / "mind.py").write_text(script())
    said: list[Any] = []

    def run() -> None:
        command = [sys.executable, str(tmp_path / "mind.py"), endpoint, "test/scout"]
        said.append(subprocess.run(command, capture_output=True, text=True, timeout=60, check=False))

    mind = example(endpoint, tmp_path, run)
    assert shown(mind) == part_of(PAGE, "example"), "`python -m tests.agentd.mind_format_page` rewrites it"
    (ended,) = said
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout.splitlines() == [belief["text"] for belief in mind["beliefs"]]


def test_the_example_is_the_record_and_no_more() -> None:
    said = json.loads(part_of(PAGE, "example").removeprefix("```json\n").removesuffix("```\n"))
    view = msgspec.convert(said, mind_records.MindView, strict=True)
    again = json.loads(msgspec.json.encode(view))
    assert steady(again) == said, "no field is unknown to the record"


def test_each_kind_of_input_and_activity_event_is_in_the_tables_and_no_other() -> None:
    text = PAGE.read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| (`\w+`(?:, `\w+`)*) \|", text.partition("An input has a `kind`")[2].partition("\n\nLiterals")[0], re.M
    )
    assert {name for row in rows for name in re.findall(r"\w+", row)} == {*KINDS, UNWRITTEN}
    activity = text.partition("**`trace/activity`**")[2].partition("**`trace/decisions`**")[0]
    described = {name for row in re.findall(r"^\| (`[^|]*`) \|", activity, re.M) for name in re.findall(r"\w+", row)}
    kinds = next(field for field in msgspec.structs.fields(mind_records.ActivityEvent) if field.name == "kind")
    assert described == set(kinds.type.__args__)
