"""Simulated robots: which need a process, its command, and what cannot be simulated.

`simulate: {vehicle: copter, home: [...]}` and `simulate: {vehicle: turtle}` are processes, `bridged simulate`. With
`simulate: {}` no process is started: the robot's driver uses its simulated twin.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import msgspec

from argosy.processes.mavlink_links import MEETING, address_of, group_of, peer_of
from bridged.drivers.mavlink.transport.address import LinkAddress
from bridged.drivers.python.plugins import TWINS, has_plugin, names
from bridged.simulation.vehicle.fault_injection import Faults
from bridged.simulation.vehicle.kinds import KINDS
from bridged.simulation.vehicle.world import Area, Victim, victims_of
from schemas.files.findings import Finding, Findings, did_you_mean
from schemas.manifest.loader import Manifest, load_manifest
from schemas.mission.model import Mission, Robot, World

_NO_TWIN = "mavlink"
"""The driver without a simulated twin: its vehicles are processes."""

SHORTEST_BATTERY = 6.0
"""Shortest life of a simulated battery, in seconds."""
SHORTEST_RECHARGE = 1.0
"""Shortest time to charge it, in seconds."""


def _vehicle(mission: Mission, name: str, router: str, address: str | None) -> list[str]:
    robot = mission.robots[name]
    assert robot.simulate is not None
    settings = robot.simulate
    home = ",".join(map(repr, settings.home or ()))
    link = str(peer_of(LinkAddress.parse(robot.link), address))
    arguments = ["--link", link, f"--home={home}", "--sysid", str(robot.sysid)]  # `=`: a latitude may be negative
    arguments += [] if settings.autopilot == "ardupilot" else ["--autopilot", settings.autopilot]
    arguments += [f"--param={name}={value!r}" for name, value in settings.parameters.items()]
    arguments += [f"--fault={fault}" for fault in settings.faults]
    arguments += [] if settings.battery is None else [f"--battery-minutes={settings.battery / 60:g}"]
    arguments += [] if settings.recharge is None else [f"--recharge-seconds={float(settings.recharge):g}"]
    arguments += camera_arguments(mission, name, router)
    if robot.signing is None:
        return arguments
    return [*arguments, "--signing-passphrase-file", str(mission.relative(robot.signing.passphrase_file))]


def _turtle(mission: Mission, name: str, router: str, address: str | None) -> list[str]:
    prefix = mission.robots[name].prefix
    return ["--router", router, *(["--prefix", prefix] if prefix else [])]  # its manifest names it


ON_MAVLINK = tuple(dict.fromkeys(vehicle for vehicle, _ in KINDS))
"""Simulated vehicles that have an autopilot."""

VEHICLES: dict[str, Callable[[Mission, str, str, str | None], list[str]]] = {
    **dict.fromkeys(ON_MAVLINK, _vehicle),
    "turtle": _turtle,
}
"""What `bridged simulate` can be, and its arguments for a robot, the endpoint of its board's router and the address of
its board, if that is another machine."""


def vehicle_of(robot: Robot) -> str:
    """Return the simulator of a robot; empty = no process."""
    return robot.simulate.process if robot.simulate is not None else ""


def linkless(mission: Mission) -> list[str]:
    """Return the simulated vehicles that the mission names no link to."""
    return [name for name, robot in mission.robots.items() if vehicle_of(robot) in ON_MAVLINK and not robot.link]


def require_links(mission: Mission) -> None:
    """Raise Findings for simulated vehicles that the mission names no link to."""
    if robots := linkless(mission):
        text = "needs the field `link`: only `argosy run` and `argosy trial` find one for a simulated vehicle"
        raise Findings([mission.positions.finding(("robots", name), f"{name} {text}") for name in robots])


def linked(mission: Mission, links: Callable[[list[str]], Mapping[str, str]]) -> tuple[Mission, Mapping[str, str]]:
    """Return a mission with a link of `links` for each vehicle that it names none for, and those links by robot."""
    found = links(linkless(mission))
    robots = {name: msgspec.structs.replace(mission.robots[name], link=link) for name, link in found.items()}
    return replace(mission, robots=mission.robots | robots), found


def machine_of(robot: Robot) -> str:
    """Return the machine of a robot's simulator: a board, or a machine for simulators only."""
    return (robot.simulate.board if robot.simulate is not None else None) or robot.board


def command(
    mission: Mission, name: str, router: str, address: str | None = None, logs: Path | None = None
) -> list[str]:
    """Return the command of a robot's simulator, without `--speed`.

    `address` is that of the robot's board if it is another machine, `logs` a folder for what a referee reads. Raises
    LinkAddressError if the simulator could not reach the bridge.
    """
    vehicle = vehicle_of(mission.robots[name])
    logged = ["--servo-log", str(servo_log(logs, name))] if vehicle in ON_MAVLINK and logs is not None else []
    return ["bridged", "simulate", vehicle, *VEHICLES[vehicle](mission, name, router, address), *logged]


def check_simulations(mission: Mission, manifests: Mapping[str, Manifest | None]) -> list[Finding]:
    """Return what is wrong with the robots' `simulate`."""
    findings = check_world(mission)
    for name, robot in mission.robots.items():
        where: tuple[str, ...] = ("robots", name, "simulate")
        vehicle, manifest = vehicle_of(robot), manifests.get(name)
        if robot.simulate is None:
            continue
        if vehicle and vehicle not in VEHICLES:
            text = f"simulate.vehicle: there is no simulated `{vehicle}`{did_you_mean(vehicle, VEHICLES)}"
            findings.append(mission.positions.finding((*where, "vehicle"), text))
        elif vehicle in ON_MAVLINK and robot.simulate.home is None:
            text = f"simulate: a {vehicle} needs the field `home`: [latitude, longitude, metres above mean sea level]"
            findings.append(mission.positions.finding(where, text))
        elif problems := _of_a_vehicle(robot):
            findings += [mission.positions.finding((*where, field), text) for field, text in problems]
        elif manifest is not None and manifest.robot.driver == _NO_TWIN and vehicle != manifest.robot.vehicle:
            wanted = manifest.robot.vehicle
            if robot.simulate.vehicle:
                where = (*where, "vehicle")
                text = f"simulate.vehicle: expected `{wanted}`, the vehicle of its manifest, got `{vehicle}`"
            else:
                text = f"simulate: a {wanted} on MAVLink needs a simulator: `{{vehicle: {wanted}, home: [...]}}`"
            findings.append(mission.positions.finding(where, text))
    return findings


def _of_a_vehicle(robot: Robot) -> list[tuple[str, str]]:
    """Return the problems of settings that only a simulated vehicle on MAVLink has: field and text."""
    settings = robot.simulate
    assert settings is not None
    given: dict[str, object] = {
        "parameters": settings.parameters,
        "battery": settings.battery,
        "recharge": settings.recharge,
        "camera": settings.camera,
        "faults": settings.faults,
    }
    if vehicle_of(robot) not in ON_MAVLINK:
        given["autopilot"] = settings.autopilot != "ardupilot"
        vehicles = f"{', '.join(ON_MAVLINK[:-1])} or {ON_MAVLINK[-1]}" if len(ON_MAVLINK) > 1 else ON_MAVLINK[0]
        return [(field, f"simulate.{field}: only a simulated {vehicles} has this") for field in given if given[field]]
    problems = []
    try:
        Faults.parse(settings.faults)
    except ValueError as error:
        problems.append(("faults", f"simulate.faults: {error}"))
    kind = KINDS[vehicle_of(robot), settings.autopilot]
    for name, value in settings.parameters.items():
        try:
            kind.check((name, value))
        except ValueError as error:
            problems.append(("parameters", f"simulate.parameters: {error}"))
    if settings.battery is not None and settings.battery < SHORTEST_BATTERY:
        problems.append(("battery", f"simulate.battery: expected at least {SHORTEST_BATTERY:g} s"))
    if settings.recharge is not None and settings.recharge < SHORTEST_RECHARGE:
        problems.append(("recharge", f"simulate.recharge: expected at least {SHORTEST_RECHARGE:g} s"))
    return problems


def only_real(mission: Mission) -> dict[str, str]:
    """Return the robots that declare a simulation but cannot be simulated, and why: their link, or a plug-in."""
    found: dict[str, str] = {}
    for name, robot in mission.robots.items():
        if robot.simulate is not None and (plugin := _without_twin(robot, mission)):
            found[name] = f"the plug-in `{plugin}` has no simulated twin (entry point of `{TWINS}`)"
            continue
        link = address_of(robot)
        if link is None or not vehicle_of(robot):
            continue
        others = [other for other in group_of(mission, name) if other != name]
        real = [other for other in others if mission.robots[other].simulate is None]
        if link.kind == "serial":
            found[name] = "a serial line cannot be simulated"
        elif real:
            found[name] = f"{real[0]} on the same link is not simulated"
        elif others and link.kind not in MEETING:
            found[name] = f"it shares a {link.kind} link, and simulated robots can share only a udpin or tcpin link"
    return found


def _without_twin(robot: Robot, mission: Mission) -> str:
    """Return a plug-in of Python functions that only the real robot has; empty if there is none."""
    if not isinstance(robot.manifest, str):  # INI manifests name none
        return ""
    try:
        manifest = load_manifest(robot.manifest, mission.path.parent)
    except Findings:
        return ""  # reported on its own
    if "python" not in manifest.drivers():
        return ""
    plugins = dict.fromkeys(name.partition(".")[0] for name in names(manifest.part("python")))
    return next((plugin for plugin in plugins if not has_plugin(plugin, TWINS)), "")


SIGHTINGS = "victim"
"""Key on which a camera reports victims, after the robot's prefix."""


def victims(world: World) -> list[Victim]:
    """Return the victims of a mission's world. Raises ValueError if it has no room for them."""
    return victims_of(world.seed, world.victims, Area(*world.area))


def servo_log(folder: Path, robot: str) -> Path:
    """Return the file of a robot's servo log."""
    return folder / f"{robot}.servo.jsonl"


def camera_arguments(mission: Mission, name: str, router: str) -> list[str]:
    """Return the camera's arguments of a copter's simulator; empty without a camera."""
    robot, world = mission.robots[name], mission.world
    if robot.simulate is None or robot.simulate.camera is None or world is None:
        return []
    key = f"{robot.prefix}/{SIGHTINGS}" if robot.prefix else SIGHTINGS
    seen = ",".join(map(repr, (world.victims, world.seed, *world.area)))
    return [f"--victims={seen}", f"--camera={robot.simulate.camera:g}", f"--camera-key={key}", f"--router={router}"]


def check_world(mission: Mission) -> list[Finding]:
    """Return what is wrong with the world and with the cameras that look at it."""
    findings: list[Finding] = []
    if mission.world is not None:
        try:
            victims(mission.world)
        except ValueError as error:
            findings.append(mission.positions.finding(("world",), f"world: {error}"))
    for name, robot in mission.robots.items():
        if mission.world is None and robot.simulate is not None and robot.simulate.camera is not None:
            text = "simulate.camera: the mission has no `world` to look at"
            findings.append(mission.positions.finding(("robots", name, "simulate", "camera"), text))
    return findings
