"""How commands find the router of a run on this machine."""

import os
from pathlib import Path

import pytest

from commd.process.local_runs import announced, local_runs, router_of, starting
from schemas.files.findings import Findings
from tests.support.buses import FLEET, Connect
from tests.support.ports import free_port

USUAL = "tcp/127.0.0.1:7447"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep the runs of other processes out."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / f"argosy-{os.getuid()}"


async def test_a_run_is_found_by_its_fleet_or_as_the_only_one_while_it_lasts() -> None:
    usual = f"tcp/127.0.0.1:{free_port()}"
    assert await router_of("", usual) == usual
    with announced("sar", "tcp/127.0.0.1:7450"):
        assert await router_of("sar", usual) == await router_of("", usual) == "tcp/127.0.0.1:7450"
        assert await router_of("other", usual) == usual
    assert local_runs() == []


async def test_of_several_runs_none_is_guessed(monkeypatch: pytest.MonkeyPatch) -> None:
    with announced("sar", "tcp/127.0.0.1:7450"):
        monkeypatch.setattr("os.getpid", lambda: 1)
        with announced("survey", USUAL):
            assert await router_of("sar", USUAL) == "tcp/127.0.0.1:7450"
            with pytest.raises(Findings, match=r"several missions run on this machine, survey at .*, sar at tcp/"):
                await router_of("", USUAL)


async def test_a_simulation_does_not_hide_daemons_that_no_run_has_started(connect: Connect, endpoint: str) -> None:
    with announced(FLEET, "tcp/127.0.0.1:7450"):
        assert await router_of(FLEET, endpoint) == "tcp/127.0.0.1:7450", "nobody of the fleet is at the router"
        await (await connect("uav1", "bridged")).claim("uav1")
        assert await router_of("another", endpoint) == endpoint
        with pytest.raises(Findings, match=rf"{FLEET} at tcp/127.0.0.1:7450, daemons of {FLEET} at {endpoint}"):
            await router_of(FLEET, endpoint)
        with pytest.raises(Findings, match=r"name one by --fleet or --router"):
            await router_of("", endpoint)


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


@pytest.mark.parametrize("made", ["writable by all", "a link"])
def test_in_a_folder_that_another_user_has_prepared_nothing_is_read_or_written(
    made: str, folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Without XDG_RUNTIME_DIR it is below /tmp, where anybody can make it first, with links to files of ours."""
    there = folder if made == "writable by all" else tmp_path / "there"
    there.mkdir()
    if made == "a link":
        folder.symlink_to(there)
    else:
        folder.chmod(0o777)
    mine = tmp_path / "mission.yaml"
    mine.write_text("mission: mine")
    for name in (f"{os.getpid()}.json", "tcp_127_0_0_1_7447.starting"):
        (there / name).symlink_to(mine)
    with starting(USUAL, lambda: None), announced("sar", USUAL):
        assert local_runs() == []
    assert mine.read_text() == "mission: mine"
    assert len(list(there.iterdir())) == 2
    assert "commands on this machine must name the router of this run" in caplog.text


def test_a_run_behind_another_loopback_is_not_ours(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with announced("sar", "tcp/127.0.0.1:7450"):
        monkeypatch.setattr("commd.process.local_runs._network", lambda: 1)
        assert local_runs() == []


def _network() -> int:
    return os.stat("/proc/self/ns/net").st_ino
