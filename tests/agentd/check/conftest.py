"""`agentd check` in a folder of its own."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import pytest

from tests.agentd.conftest import Command, Ran


class Checked(Ran):
    """What the command has said."""

    @property
    def findings(self) -> list[dict[str, Any]]:
        """The findings of `--json`."""
        found: list[dict[str, Any]] = json.loads(self.out)
        return found

    @property
    def kinds(self) -> set[tuple[str, int, str]]:
        """File, line and kind of each finding of `--json`."""
        return {(Path(one["file"]).name, one["line"], one["kind"]) for one in self.findings}


Check: TypeAlias = Callable[..., Checked]


@pytest.fixture
def check(command: Command) -> Check:
    """Write files by name, or the program a.asl, and check the first of them, or those that the arguments name."""

    def check(files: dict[str, str] | str, *arguments: str) -> Checked:
        files = {"a.asl": files} if isinstance(files, str) else files
        if not any(argument.endswith((".asl", ".mas2j")) for argument in arguments):
            arguments = (*arguments, next(iter(files)))
        ran = command(files, "check", *arguments)
        return Checked(ran.code, ran.out, ran.err)

    return check
