"""An agent that cannot be saved is a failure of the plan that saves it."""

from __future__ import annotations

from pathlib import Path

from tests.agentd.teams import Stage


def test_a_name_that_no_file_can_have_fails_the_plan(tmp_path: Path) -> None:
    stage = Stage({"bob": f'!s. +!s <- .save_agent("{tmp_path}/a\0b"). -!s[error_msg(M)] <- .print(M).'})
    assert stage.run() == 0
    assert stage.lines == [f"[bob] cannot write {tmp_path}/a\\x00b: embedded null byte"]
