"""`argosy simulate`: the simulated robots of one machine, for bridges that run elsewhere."""

import signal
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from argosy.__main__ import main
from tests.support.processes import running

FLEET = """\
mission: field
boards: {pi1: {address: 127.0.0.2}, pi2: {address: 127.0.0.3}}
agents:
  one: {program: p.asl, robot: uav1, board: pi1}
  two: {program: p.asl, robot: uav2, board: pi2}
robots:
  uav1:
    board: pi1
    manifest: copter
    link: udpin:0.0.0.0:PORT1
    simulate: {board: sim, home: [-27.6, -48.5, 21.0]}
  uav2:
    board: pi2
    manifest: copter
    link: udpin:0.0.0.0:PORT2
    simulate: {home: [-27.6, -48.5, 21.0]}
done: "one: enough"
"""


@pytest.fixture
def field(tmp_path: Path, free_port: Callable[[], int]) -> Path:
    """Return a mission of two copters: one is simulated on the machine `sim`, the other on its own board."""
    (tmp_path / "p.asl").write_text("!begin.\n+!begin <- +enough.\n")
    path = tmp_path / "field.yaml"
    path.write_text(FLEET.replace("PORT1", str(free_port())).replace("PORT2", str(free_port())))
    return path


def test_a_bridge_hears_the_simulated_vehicle_of_another_machine(
    field: Path, endpoint: str, free_port: Callable[[], int], tmp_path: Path
) -> None:
    board = (str(field), "--board", "pi1", "--router", endpoint)
    links = ("--listen", f"tcp/127.0.0.1:{free_port()}")
    state = ("--state", str(tmp_path / "state"))
    with (
        running("commd", "serve", *board, *links, *state),
        running("bridged", "serve", *board, *state) as bridge,
        running("argosy", "simulate", str(field), "--board", "sim", "--speed", "5") as simulation,
    ):
        bridge.says("serving uav1")
        simulation.says("simulator uav1: simulated copter 1 on udpout:127.0.0.2:")
        bridge.says("system 1 is heard now")
        assert "uav2" not in simulation.text + bridge.text
        simulation.signal(signal.SIGINT)
        assert simulation.ends() == 0


def test_a_simulator_on_the_board_of_its_robot_calls_it_there(field: Path) -> None:
    with running("argosy", "simulate", str(field), "--board", "pi2") as simulation:
        simulation.says("simulator uav2: simulated copter 1 on udpout:127.0.0.1:")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ([], "name this machine by --board: there is pi2, sim"),
        (["--board", "sin"], "nothing is simulated on `sin`, did you mean `sim`?"),
        (["--board", "sim", "--real", "uav7"], "--real uav7: there is no such robot"),
        (["--board", "sim", "--real", "all"], "nothing is simulated on `sim`"),
    ],
)
def test_what_cannot_be_simulated_is_said_and_is_bad_input(
    field: Path, arguments: list[str], problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", str(field), *arguments]) == 2
    assert problem in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("udpin:0.0.0.0", "udpin:127.0.0.1", "uav1: link 'udpin:127.0.0.1:"),
        ("    link: udpin:0.0.0.0:", "    # ", "uav1 needs the field `link`: only `argosy run`"),
        ("pi1: {address: 127.0.0.2}", "pi1: {}", "the simulator is elsewhere, and the robot's board has no `address`"),
    ],
)
def test_a_bridge_that_cannot_be_reached_is_said_before_anything_starts(
    field: Path, old: str, new: str, problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    field.write_text(field.read_text().replace(old, new))
    assert main(["simulate", str(field), "--board", "sim"]) == 2
    assert problem in capsys.readouterr().err


def test_a_simulator_that_dies_ends_the_command_and_is_named(field: Path, free_port: Callable[[], int]) -> None:
    field.write_text(field.read_text().replace("udpin:0.0.0.0", "udpout:127.0.0.9"))
    field.write_text(field.read_text().replace("board: sim, home", "home"))
    with running("argosy", "simulate", str(field), "--board", "pi1") as first:
        first.says("simulated copter 1 on udpin:127.0.0.9:")
        assert main(["simulate", str(field), "--board", "pi1"]) == 2  # its end of the link is taken
        for child in psutil.Process(first.process.pid).children(recursive=True):
            child.kill()
        assert first.ends() == 1
        first.says("error: simulator uav1 was killed by SIGKILL")


def test_a_board_without_robots_has_no_bridge_and_a_fleet_is_asked_which_it_is(field: Path, endpoint: str) -> None:
    field.write_text(field.read_text().replace("pi2: {address: 127.0.0.3}", "pi2: {address: 127.0.0.3}, pi3: {}"))
    for arguments, problem in {
        ("--board", "pi3"): "board `pi3` has no robots",
        ("--board", "pi9"): "there is no board `pi9`",
        (): "which robots? Name them, or by --board one of pi1, pi2, pi3",
    }.items():
        with running("bridged", "serve", str(field), *arguments, "--router", endpoint) as bridge:
            assert bridge.ends() == 2
            assert problem in bridge.text


def test_two_boards_with_one_port_are_refused_where_both_are_one_machine(
    field: Path, endpoint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = field.read_text()
    ports = [line.rpartition(":")[2] for line in text.splitlines() if "link:" in line]
    field.write_text(text.replace(ports[1], ports[0]))
    assert main(["check", str(field)]) == 0
    assert main(["run", str(field), "--router", endpoint]) == 2
    told = f"udpin:0.0.0.0:{ports[0]} is a link of pi1 and of pi2, and here they are one machine: give uav2 another one"
    assert told in capsys.readouterr().err
