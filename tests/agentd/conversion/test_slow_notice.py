"""Loading that takes long is told of, once."""

from __future__ import annotations

from time import process_time, sleep

import pytest

from agentd.conversion.slow_notice import loading, told_if_long


def _work(seconds: float) -> None:
    end = process_time() + seconds
    while process_time() < end:
        pass


def test_what_takes_long_is_told_once_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    with told_if_long(loading(["a.asl", "b.asl", "c.asl", "d.asl"]), after=0.02):
        _work(0.2)
    assert capsys.readouterr().err == "still loading a.asl, b.asl, c.asl and 1 more ...\n"


def test_what_only_waits_for_the_processor_is_not_told(capsys: pytest.CaptureFixture[str]) -> None:
    with told_if_long("never", after=0.1):
        sleep(0.15)
    assert capsys.readouterr().err == ""
