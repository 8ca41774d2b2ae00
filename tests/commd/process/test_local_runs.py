"""How commands find the router of a run on this machine."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from commd.process.local_runs import announced, local_runs, router_of, starting
from schemas.files.findings import Findings

USUAL = "tcp/127.0.0.1:7447"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep the runs of other processes out."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / f"argosy-{os.getuid()}"


def test_a_run_is_found_by_its_fleet_or_as_the_only_one_while_it_lasts() -> None:
    assert router_of("", USUAL) == USUAL
    with announced("sar", "tcp/127.0.0.1:7450"):
        assert router_of("sar", USUAL) == router_of("", USUAL) == "tcp/127.0.0.1:7450"
        assert router_of("other", USUAL) == USUAL
    assert local_runs() == []


def test_of_several_runs_none_is_guessed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with announced("sar", "tcp/127.0.0.1:7450"):
        monkeypatch.setattr("os.getpid", lambda: 1)
        with announced("survey", USUAL):
            assert router_of("sar", USUAL) == "tcp/127.0.0.1:7450"
            with pytest.raises(Findings, match=r"several missions run on this machine, survey at .*, sar at tcp/"):
                router_of("", USUAL)


def test_of_the_runs_that_want_one_router_one_starts_at_a_time() -> None:
    waited: list[str] = []
    with starting(USUAL, lambda: waited.append("first")):
        with starting("tcp/127.0.0.1:7448", lambda: waited.append("another router")):
            pass
        with starting(USUAL, lambda: waited.append("second"), patience=0.0):
            pass
    with starting(USUAL, lambda: waited.append("third")):
        pass
    assert waited == ["second"]


def test_what_a_killed_run_has_left_is_no_run(folder: Path) -> None:
    folder.mkdir()
    (folder / "7.json").write_text(f'{{"fleet": "sar", "router": "tcp/127.0.0.1:9", "network": {_network()}}}')
    assert local_runs() == []


def test_a_run_behind_another_loopback_is_not_ours(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with announced("sar", "tcp/127.0.0.1:7450"):
        monkeypatch.setattr("commd.process.local_runs._network", lambda: 1)
        assert local_runs() == []


def _network() -> int:
    return os.stat("/proc/self/ns/net").st_ino
