"""The table of processes: what is started for a mission, in which order, with which commands."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from argosy.processes import Setup, bound_links, check_links, only_real, peer_of, plan, real_robots
from bridged.drivers.mavlink.address import LinkAddress, LinkAddressError
from schemas.mission import Mission, read_mission

TWO = """\
mission: two
boards: {pi1: {address: 10.0.0.11}, pi2: {address: 10.0.0.12}}
agents:
  scout: {program: scout.asl, robot: uav1, board: pi1}
  rescuer: {program: rescuer.asl, robot: uav2, board: pi2}
  ground: {program: ground.asl, board: pi1}
robots:
  uav1:
    board: pi1
    manifest: arducopter
    link: udpin:0.0.0.0:14550
    simulate: {home: [-27.6, -48.5, 21]}
  uav2:
    board: pi2
    manifest: arducopter
    link: tcp:127.0.0.1:5760
    sysid: 2
    simulate: {home: [1.5, 2.5, 0]}
"""


def mission(text: str = TWO) -> Mission:
    """Read a mission that needs no files."""
    return read_mission(text, Path("/missions/two.yaml"))


def commands(real: frozenset[str] = frozenset()) -> dict[str, str]:
    """Return the command of each process, by its name."""
    setup = Setup(mission(), "tcp/127.0.0.1:9000", 5.0, real, Path("/state"))
    return {process.name: " ".join(process.argv[3:]) for process in plan(setup)}


def test_every_process_has_its_command_in_the_order_of_the_start() -> None:
    file, router, speed = "/missions/two.yaml", "--router tcp/127.0.0.1:9000", "--speed 5"
    assert list(commands().items()) == [
        ("commd", f"commd serve {file} --board pi1 {router}"),
        (
            "simulator uav1",
            f"bridged simulate copter --link udpout:127.0.0.1:14550 --home=-27.6,-48.5,21.0 --sysid 1 {speed}",
        ),
        (
            "simulator uav2",
            f"bridged simulate copter --link tcpin:127.0.0.1:5760 --home=1.5,2.5,0.0 --sysid 2 {speed}",
        ),
        ("bridged uav1", f"bridged serve {file} uav1 {router} {speed} --state /state"),
        ("bridged uav2", f"bridged serve {file} uav2 {router} {speed} --state /state"),
        ("agentd scout ground", f"agentd serve {file} scout ground {router} {speed}"),
        ("agentd rescuer", f"agentd serve {file} rescuer {router} {speed}"),
    ]


def test_a_real_robot_has_no_simulator() -> None:
    assert [name for name in commands(frozenset({"uav1"})) if name.startswith("simulator")] == ["simulator uav2"]


@pytest.mark.parametrize(
    ("link", "peer"),
    [
        ("udpin:127.0.0.1:14550", "udpout:127.0.0.1:14550"),
        ("udpin:0.0.0.0:14550", "udpout:127.0.0.1:14550"),
        ("udpout:127.0.0.1:14550", "udpin:127.0.0.1:14550"),
        ("tcp:localhost:5760", "tcpin:localhost:5760"),
        ("tcpin:[::]:5760", "tcp:[::1]:5760"),
    ],
)
def test_a_simulator_stands_at_the_other_end_of_the_link(link: str, peer: str) -> None:
    assert str(peer_of(LinkAddress.parse(link))) == peer


def test_nobody_can_be_simulated_behind_a_serial_line() -> None:
    with pytest.raises(LinkAddressError, match="a simulated robot needs a udpin, udpout, tcp or tcpin link"):
        peer_of(LinkAddress.parse("serial:/dev/ttyAMA0:57600"))
    text = TWO.replace("udpin:0.0.0.0:14550", "serial:/dev/ttyAMA0:57600")
    assert check_links(mission(text)) == []
    assert only_real(mission(text)) == ["uav1"]


def test_the_ends_of_links_that_this_machine_binds_are_known() -> None:
    def bound(*real: str) -> dict[str, str]:
        setup = Setup(mission(), "tcp/127.0.0.1:9000", 1.0, frozenset(real), Path("/state"))
        return {name: str(link) for name, link in bound_links(setup).items()}

    assert bound() == {"uav1": "udpin:0.0.0.0:14550", "uav2": "tcpin:127.0.0.1:5760"}
    assert bound("uav1", "uav2") == {"uav1": "udpin:0.0.0.0:14550"}


@pytest.mark.parametrize(
    ("named", "real", "unknown"),
    [
        ([], set(), []),
        (["uav2"], {"uav2"}, []),
        (["scout"], {"uav1"}, []),
        (["all"], {"uav1", "uav2"}, []),
        (["uav1", "uav7", "ground"], {"uav1"}, ["uav7", "ground"]),
    ],
)
def test_real_robots_are_named_by_themselves_by_their_agent_or_all(
    named: list[str], real: set[str], unknown: list[str]
) -> None:
    assert real_robots(mission(), named) == (frozenset(real), unknown)


def test_a_robot_without_simulate_is_real_in_any_case() -> None:
    text = TWO.replace("    simulate: {home: [1.5, 2.5, 0]}\n", "")
    assert real_robots(mission(text), []) == (frozenset({"uav2"}), [])


@pytest.mark.parametrize(
    ("one", "other", "collide"),
    [
        ("udpin:127.0.0.1:14550", "udpin:localhost:14550", True),
        ("udpin:0.0.0.0:14550", "udpin:127.0.0.2:14550", True),
        ("udpin:127.0.0.1:14550", "udpin:127.0.0.2:14550", False),
        ("udpin:127.0.0.1:14550", "udpin:127.0.0.1:14551", False),
        ("tcp:0.0.0.0:5760", "tcp:127.0.0.1:5760", False),
    ],
)
def test_links_that_are_one_in_truth_are_found(one: str, other: str, collide: bool) -> None:
    text = TWO.replace("udpin:0.0.0.0:14550", one).replace("tcp:127.0.0.1:5760", other)
    assert bool(check_links(mission(text))) == collide


def test_when_argosy_is_killed_only_the_bridge_of_a_real_robot_lives_on_to_bring_it_home() -> None:
    setup = Setup(mission(), "tcp/127.0.0.1:9000", 1.0, frozenset({"uav1"}), Path("/state"))
    assert [process.name for process in plan(setup) if process.orphaned != signal.SIGKILL] == ["bridged uav1"]
