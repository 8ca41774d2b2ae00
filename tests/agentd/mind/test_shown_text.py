"""Text of others reaches terminals and logs as text: no control character, no line in somebody else's name."""

import logging
import os
from types import SimpleNamespace

import pytest

from agentd.mind.data.effects import Print
from agentd.runtime.agent_host import AgentHost
from commd.process.log_handler import LineFormatter
from commd.process.output import Output
from schemas.files.findings import Finding
from schemas.humanize import escape_line, escape_lines
from tests.agentd.teams import played

HOSTILE = "\x1b]0;owned\x07\x1b[2J\r\u009b31m\u202eERROR\nERROR bridged orders robot=uav1 lost"


def test_what_a_program_prints_sends_no_terminal_a_command() -> None:
    assert (
        "".join(played({"bob": '!s. +!s <- .print("a\x1b[2Jb\u202ec", "\\nsecond\tline").'}))
        == "[bob] a\\x1b[2Jb\\u202ec\nsecond\tline"
    )


def test_each_line_that_a_served_agent_prints_has_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    reader, writer = os.pipe()
    out = Output(writer)

    class Told:
        name = "bob"

        def did(self, cycle: int, effect: object) -> None:
            pass

    host = AgentHost.__new__(AgentHost)
    host._tracing = SimpleNamespace(activity=Told())  # type: ignore[assignment]
    beliefs = SimpleNamespace(mark=lambda now: None)
    host._mind = SimpleNamespace(cycle=0, now=0.0, beliefs=beliefs)  # type: ignore[assignment]
    host.part, host._prints = Told(), []  # type: ignore[assignment]
    monkeypatch.setattr("agentd.runtime.agent_host.stdout", lambda: out)
    for plain in (False, True):
        host._carry_out([Print(HOSTILE, plain=plain)])
    out.flush(10)
    assert os.read(reader, 10_000).decode().splitlines() == 2 * [
        "[bob] \\x1b]0;owned\\x07\\x1b[2J\\r\\x9b31m\\u202eERROR",
        "[bob] ERROR bridged orders robot=uav1 lost",
    ]
    os.close(reader)


def test_a_log_line_and_a_finding_show_what_they_name_as_text() -> None:
    record = logging.LogRecord("mail", logging.INFO, "", 0, "agent=%s", (HOSTILE,), None)
    assert (
        LineFormatter("%(levelname)s agentd %(name)s ").format(record)
        == f"INFO agentd mail agent={escape_line(HOSTILE)}"
    )
    assert "\x1b" not in str(Finding(HOSTILE, 1, 1, HOSTILE))
    assert escape_line(HOSTILE).isprintable()
    assert escape_lines("a\tb\nc\ud800é") == "a\tb\nc\\ud800é"
