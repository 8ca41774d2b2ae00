"""What a process says to its service manager, heard at a real socket; time is the test's."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from commd.process.systemd import Unit
from tests.support.notify_socket import NotifySocket


class Now:
    """A clock that a test turns."""

    def __init__(self) -> None:
        self.at = 100.0

    def __call__(self) -> float:
        return self.at


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[NotifySocket]:
    address = tmp_path / "notify" if request.param == "path" else f"@argosy-{os.getpid()}-{tmp_path.name}"
    with NotifySocket(address) as socket:
        yield socket


def test_what_is_told_arrives_at_a_path_and_at_an_abstract_name(manager: NotifySocket) -> None:
    member = Unit(manager.environment()).member("commd")
    member.status("waiting for", "the router")
    member.ready("router of pi1")
    member.stopping()
    assert manager.take() == [
        {"STATUS": "waiting for; the router"},
        {"STATUS": "router of pi1", "READY": "1"},
        {"STATUS": "router of pi1", "STOPPING": "1"},
    ]


def test_without_a_service_manager_nothing_happens() -> None:
    member = Unit({}).member("commd")
    loop = member.loop()
    member.ready("up")
    loop.beat()
    member.stopping()
    assert loop.period is None


@pytest.mark.parametrize("address", ["/nowhere/at/all", "vsock:2:1234"])
def test_an_unreachable_socket_is_a_warning_and_not_the_end(address: str, caplog: pytest.LogCaptureFixture) -> None:
    Unit({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "1000000"}).member("commd").ready("up")
    assert f"NOTIFY_SOCKET={address}" in caplog.text
    assert "nothing is sent" in caplog.text


def test_status_is_one_line_and_told_once(manager: NotifySocket) -> None:
    member = Unit(manager.environment()).member("agentd")
    for _ in range(3):
        member.status("two\nlines READY=1", "x" * 1000)
    assert len(manager.take()) == 1
    assert manager.said[0]["STATUS"].startswith("two lines READY=1; xxx")
    assert len(manager.said[0]["STATUS"]) == 500


def test_of_several_daemons_in_one_process_all_must_be_ready_and_the_status_is_of_all(manager: NotifySocket) -> None:
    unit = Unit(manager.environment())
    commd, agentd = unit.member("commd"), unit.member("agentd")
    commd.ready("router of pi1")
    assert not manager.fields("READY")
    agentd.ready("reasoning: scout")
    agentd.status("reasoning: nobody")
    assert manager.fields("READY") == ["1"]
    assert manager.fields("STATUS")[-1] == "commd: router of pi1; agentd: reasoning: nobody"


def test_the_watchdog_is_fed_when_every_loop_has_turned_and_no_more_often_than_needed(manager: NotifySocket) -> None:
    now = Now()
    member = Unit(manager.environment(watchdog=8), now).member("bridged")
    one, other = member.loop(), member.loop()
    assert one.period == 2
    for _ in range(80):  # 8 s
        one.beat()
        other.beat()
        now.at += 0.1
    assert 7 <= len(manager.fields("WATCHDOG")) <= 9


def test_one_loop_that_hangs_is_enough_to_starve_the_watchdog(manager: NotifySocket) -> None:
    now = Now()
    member = Unit(manager.environment(watchdog=8), now).member("agentd")
    works, hangs = member.loop(), member.loop()
    hangs.beat()
    for _ in range(10):
        works.beat()
        now.at += 2
    fed = len(manager.fields("WATCHDOG"))
    assert fed <= 1
    hangs.end()  # an agent that has left is waited for no longer
    works.beat()
    assert len(manager.fields("WATCHDOG")) == fed + 1


def test_a_loop_that_waits_for_what_may_take_long_is_not_missed_until_its_next_beat(manager: NotifySocket) -> None:
    now = Now()
    member = Unit(manager.environment(watchdog=8), now).member("bridged")
    works, opens = member.loop(), member.loop()
    opens.rest()
    for _ in range(10):
        works.beat()
        now.at += 2
    assert len(manager.fields("WATCHDOG")) == 10
    opens.beat()
    for _ in range(10):
        works.beat()
        now.at += 2
    assert len(manager.fields("WATCHDOG")) <= 12


def test_the_watchdog_of_another_process_is_not_fed(manager: NotifySocket) -> None:
    loop = Unit(manager.environment(watchdog=8, pid=1)).member("agentd").loop()
    loop.beat()
    assert loop.period is None
    assert not manager.take()


def test_a_watchdog_that_is_no_number_is_a_warning(manager: NotifySocket, caplog: pytest.LogCaptureFixture) -> None:
    assert Unit(manager.environment() | {"WATCHDOG_USEC": "soon"}).member("agentd").loop().period is None
    assert "WATCHDOG_USEC=soon is no number" in caplog.text


def test_what_a_busy_service_manager_did_not_take_is_said_with_the_next_word(manager: NotifySocket) -> None:
    member = Unit(manager.environment()).member("commd")
    for number in range(2000):  # more than its queue has room for
        member.status(f"{number}")
    member.ready("up")
    manager.take()
    member.status("still up")
    assert manager.take()[-1] == {"STATUS": "still up", "READY": "1"}
