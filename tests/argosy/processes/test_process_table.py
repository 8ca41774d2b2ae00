"""The table of processes: what is started for a mission, in which order, with which commands."""

import signal
import socket
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from argosy.processes.mavlink_links import bound_links, check_links, peer_of, together
from argosy.processes.process_table import Place, Setup, places, plan, real_robots
from argosy.processes.simulators import only_real
from bridged.drivers.mavlink.transport.address import LinkAddress, LinkAddressError
from commd.process.state_dir import state_directory
from schemas.mission.model import Mission, read_mission

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
    manifest: copter
    link: udpin:0.0.0.0:14550
    simulate: {home: [-27.6, -48.5, 21]}
  uav2:
    board: pi2
    manifest: copter
    link: tcp:127.0.0.1:5760
    sysid: 2
    simulate: {home: [1.5, 2.5, 0]}
"""


SHARED = (
    TWO.replace("board: pi2\n    manifest", "board: pi1\n    manifest")
    .replace("udpin:0.0.0.0:14550", "udpin:127.0.0.1:14550")
    .replace("tcp:127.0.0.1:5760", "udpin:127.0.0.1:14550")
)
"""Both vehicles on one link."""
TURTLE = """\
mission: pond
agents:
  painter: {program: painter.asl, robot: turtle1}
  helper: {program: helper.asl, robot: lamp1}
robots:
  turtle1: {manifest: turtle, prefix: pond, simulate: {vehicle: turtle}}
  lamp1: {manifest: lamp.toml, link: "tcp:10.0.0.7:4000", simulate: {}}
"""
"""No vehicle on MAVLink: one has a simulator of its own, the driver of the other is its own twin."""


def mission(text: str = TWO) -> Mission:
    return read_mission(text, Path("/missions/two.yaml"))


PLACES = {
    "pi1": Place("tcp/127.0.0.1:9000", "tcp/127.0.0.1:9002"),
    "pi2": Place("tcp/127.0.0.1:9001", "tcp/127.0.0.1:9003", ("tcp/127.0.0.1:9002",)),
}


def commands(real: frozenset[str] = frozenset(), text: str = TWO) -> dict[str, str]:
    """Return the command of each process, by its name."""
    setup = Setup(mission(text), "tcp/127.0.0.1:9000", 5.0, real, Path("/state"), places=PLACES)
    return {process.name: " ".join(process.argv[3:]) for process in plan(setup)}


def test_every_process_has_its_command_in_the_order_of_the_start_and_each_daemon_the_router_of_its_board() -> None:
    file, speed = "/missions/two.yaml", "--speed 5"
    pi1, pi2, state = "--router tcp/127.0.0.1:9000", "--router tcp/127.0.0.1:9001", "--state /state"
    logs = f"--logs {state_directory(None)}/two/logs"
    assert list(commands().items()) == [
        ("commd pi1", f"commd serve {file} --board pi1 {pi1} --listen tcp/127.0.0.1:9002 {state}"),
        (
            "commd pi2",
            f"commd serve {file} --board pi2 {pi2} --listen tcp/127.0.0.1:9003 --connect tcp/127.0.0.1:9002 {state}",
        ),
        (
            "simulator uav1",
            f"bridged simulate copter --link udpout:127.0.0.1:14550 --home=-27.6,-48.5,21.0 --sysid 1 {speed}",
        ),
        ("simulator uav2", f"bridged simulate copter --link tcpin:127.0.0.1:5760 --home=1.5,2.5,0.0 --sysid 2 {speed}"),
        ("bridged pi1 uav1", f"bridged serve {file} uav1 {pi1} {speed} {state} {logs} --until-home --simulated"),
        ("bridged pi2 uav2", f"bridged serve {file} uav2 {pi2} {speed} {state} {logs} --until-home --simulated"),
        ("agentd pi1", f"agentd serve {file} scout ground {pi1} {speed} {state}"),
        ("agentd pi2", f"agentd serve {file} rescuer {pi2} {speed} {state}"),
    ]


def test_the_routers_of_several_boards_take_free_ports_after_the_first_and_each_calls_those_before_it(
    free_port: Callable[[], int],
) -> None:
    port = free_port()
    with socket.create_server(("127.0.0.1", port + 1)):
        found = places(mission(), f"tcp/127.0.0.1:{port}", {port + 2})
    ports = [int(one.rpartition(":")[2]) for place in found.values() for one in (place.router, place.listen)]
    assert list(found) == ["pi1", "pi2"]
    assert ports[0] == port
    assert len({*ports}) == 4
    assert not {port + 1, port + 2} & {*ports}
    assert [place.connect for place in found.values()] == [(), (found["pi1"].listen,)]


def test_the_routers_of_several_boards_may_be_sockets_in_the_file_system() -> None:
    assert [place.router for place in places(mission(), "unixsock-stream/run/a").values()] == [
        "unixsock-stream/run/a",
        "unixsock-stream/run/a.1",
    ]


def test_boards_share_a_router_that_somebody_else_runs() -> None:
    text = TWO + "router: {external: true}\n"
    assert set(places(mission(text), "tcp/127.0.0.1:9000").values()) == {Place("tcp/127.0.0.1:9000")}


def test_one_board_has_one_router_and_listens_at_no_address_of_another_machine(free_port: Callable[[], int]) -> None:
    alone = "mission: one\nboards: {pi1: {}}\nagents: {a: {program: a.asl, board: pi1}}\n"
    router = f"tcp/127.0.0.1:{free_port()}"
    assert places(mission(alone), router) == {"pi1": Place(router)}
    far = places(mission(alone.replace("pi1: {}", "pi1: {address: 10.0.0.11}")), router)["pi1"]
    assert far.listen.startswith("tcp/127.0.0.1:")


def test_vehicles_on_the_same_link_of_two_boards_are_two_vehicles() -> None:
    text = TWO.replace("tcp:127.0.0.1:5760", "udpin:0.0.0.0:14550").replace("    sysid: 2\n", "")
    assert together(mission(text)) == [["uav1"], ["uav2"]]
    assert check_links(mission(text)) == []


def test_a_simulated_copter_is_told_its_parameters_its_battery_and_its_faults() -> None:
    more = "home: [1.5, 2.5, 0], parameters: {FS_GCS_ENABLE: 1}, battery: 10min, faults: [loss=0.2, lie]"
    started = commands(text=TWO.replace("home: [1.5, 2.5, 0]", more))["simulator uav2"]
    assert "--param=FS_GCS_ENABLE=1.0 --fault=loss=0.2 --fault=lie --battery-minutes=10 " in started


def test_robots_that_share_a_link_share_a_bridge_and_each_calls_it_by_its_own_simulator() -> None:
    file, router, speed = "/missions/two.yaml", "--router tcp/127.0.0.1:9000", "--speed 5"
    logs = f"--logs {state_directory(None)}/two/logs"
    started = commands(text=SHARED)
    assert (
        started["bridged pi1 uav1 uav2"]
        == f"bridged serve {file} uav1 uav2 {router} {speed} --state /state {logs} --until-home --simulated"
    )
    links = [line.split()[4] for name, line in started.items() if name.startswith("simulator")]
    assert links == ["udpout:127.0.0.1:14550"] * 2
    assert sum(name.startswith("bridged") for name in started) == 1


def test_a_bridge_is_told_that_its_robots_are_simulated_only_if_they_are() -> None:
    told = {name: line.endswith("--simulated") for name, line in commands(frozenset({"uav1"})).items()}
    assert (told["bridged pi1 uav1"], told["bridged pi2 uav2"]) == (False, True)


def test_a_real_robot_and_a_simulated_one_on_one_link_are_found() -> None:
    def mixed(*real: str) -> list[str]:
        return Setup(mission(SHARED), "tcp/127.0.0.1:9000", 1.0, frozenset(real), Path("/state")).mixed()

    assert mixed("uav2") == ["uav1", "uav2"]
    assert mixed() == []
    assert mixed("uav1", "uav2") == []


def test_robots_that_are_no_vehicles_have_the_simulator_that_they_declare_or_none() -> None:
    started = commands(text=TURTLE)
    turtle = "bridged simulate turtle --router tcp/127.0.0.1:9000 --prefix pond --speed 5"
    assert started["simulator turtle1"] == turtle
    assert "simulator lamp1" not in started
    assert started["bridged lamp1"].endswith("--simulated")
    setup = Setup(mission(TURTLE), "tcp/127.0.0.1:9000", 5.0, frozenset(), Path("/state"))
    assert bound_links(setup.mission, setup.simulators()) == {}


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


@pytest.mark.parametrize(
    ("link", "address", "peer"),
    [
        ("udpin:0.0.0.0:14550", "10.0.0.11", "udpout:10.0.0.11:14550"),
        ("udpin:10.9.0.1:14550", "10.0.0.11", "udpout:10.9.0.1:14550"),
        ("udpout:10.0.0.20:14550", "", "udpin:10.0.0.20:14550"),
        ("tcpin:[::]:5760", "fd00::11", "tcp:[fd00::11]:5760"),
    ],
)
def test_a_simulator_on_another_machine_calls_the_board_of_its_robot(link: str, address: str, peer: str) -> None:
    assert str(peer_of(LinkAddress.parse(link), address)) == peer


@pytest.mark.parametrize(
    ("link", "address", "problem"),
    [
        ("udpin:127.0.0.1:14550", "10.0.0.11", "it stays on its board, .*; write `udpin:0.0.0.0:14550`"),
        ("tcp:localhost:5760", "10.0.0.11", "it stays on its board, .*; write `tcp:HOST:5760`"),
        ("udpin:0.0.0.0:14550", "", "the robot's board has no `address`"),
    ],
)
def test_a_link_that_no_simulator_on_another_machine_can_reach_is_told(link: str, address: str, problem: str) -> None:
    with pytest.raises(LinkAddressError, match=problem):
        peer_of(LinkAddress.parse(link), address)


def test_nobody_can_be_simulated_behind_a_serial_line() -> None:
    with pytest.raises(LinkAddressError, match="a simulated robot needs a udpin, udpout, tcp or tcpin link"):
        peer_of(LinkAddress.parse("serial:/dev/ttyAMA0:57600"))
    text = TWO.replace("udpin:0.0.0.0:14550", "serial:/dev/ttyAMA0:57600")
    assert check_links(mission(text)) == []
    assert list(only_real(mission(text))) == ["uav1"]


def test_the_ends_of_links_that_this_machine_binds_are_known() -> None:
    def bound(*real: str) -> dict[str, str]:
        setup = Setup(mission(), "tcp/127.0.0.1:9000", 1.0, frozenset(real), Path("/state"))
        return {str(link): " ".join(names) for link, names in bound_links(setup.mission, setup.simulators()).items()}

    assert bound() == {"udpin:0.0.0.0:14550": "uav1", "tcpin:127.0.0.1:5760": "uav2"}
    assert bound("uav1", "uav2") == {"udpin:0.0.0.0:14550": "uav1"}
    assert bound_links(mission(SHARED), []) == {LinkAddress.parse("udpin:127.0.0.1:14550"): ["uav1", "uav2"]}


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
def test_real_robots_are_named_by_name_by_agent_or_all(named: list[str], real: set[str], unknown: list[str]) -> None:
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
    text = text.replace("board: pi2\n    manifest", "board: pi1\n    manifest")
    assert bool(check_links(mission(text))) == collide


def test_when_argosy_is_killed_only_the_bridge_of_a_real_robot_lives_on_to_bring_it_home() -> None:
    setup = Setup(mission(), "tcp/127.0.0.1:9000", 1.0, frozenset({"uav1"}), Path("/state"))
    assert [process.name for process in plan(setup) if process.orphaned != signal.SIGKILL] == ["bridged pi1 uav1"]
    setup = Setup(mission(SHARED), "tcp/127.0.0.1:9000", 1.0, frozenset({"uav1", "uav2"}), Path("/state"))
    assert [process.name for process in plan(setup) if process.orphaned != signal.SIGKILL] == ["bridged pi1 uav1 uav2"]


def test_logs_of_vehicles_outlast_the_run_in_its_report_or_in_the_users_state() -> None:
    setup = Setup(mission(), "tcp/127.0.0.1:9000", 5.0, frozenset(), Path("/state"), places=PLACES)
    assert setup.vehicle_logs == state_directory(None) / "two" / "logs"
    assert replace(setup, logs=Path("/report")).vehicle_logs == Path("/report/logs")
