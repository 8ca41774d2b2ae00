"""The faults of a trial: what each does, how a seed draws them, and the files that name them.

A storm of faults is followed by calm: safety is demanded always, the end of the mission only when the storm is over.
Each run draws which kinds it has and how strong (swarm testing), so that no kind hides another in every run.
"""

from __future__ import annotations

import math
import random
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias, get_args

import msgspec

from argosy.processes.process_table import Process
from argosy.processes.simulators import ON_MAVLINK, vehicle_of
from bridged.simulation.vehicle.fault_injection import Faults
from schemas.files.findings import Findings
from schemas.files.text_files import read_text
from schemas.files.units import decode_hook
from schemas.files.yaml_positions import convert, read_yaml
from schemas.mission.model import Mission

STORM: Final = 120.0
"""Virtual seconds after the start in which faults begin."""
SHARE: Final = 0.4
"""Chance of each kind of fault in a run."""
RARE: Final = 0.1
"""Chance of a kind of fault for each vehicle that its mission seldom outlives."""
MUTE: Final = 0.05
"""Chance of a vehicle that acknowledges nothing: its missions seldom succeed, and show little else."""
WORST_BATTERY: Final = 0.5
"""Least share of the time in the air that a battery of the mission lasts: it is old, or cold."""


StopOrder: TypeAlias = Literal["hold", "land", "rtl", "pause"]
Seconds: TypeAlias = Annotated[float, msgspec.Meta(ge=0)]


class _Fault(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    at: Seconds = 0.0
    """Virtual seconds after the start."""


class Kill(_Fault, frozen=True, kw_only=True, tag="kill"):
    """A daemon is killed; it is started again as its board's service manager does."""

    daemon: str
    """`commd`, `bridged` or `agentd`, and its board, robot or agent: `bridged uav1`, `agentd:pi1`; all of a kind
    without."""

    @property
    def parts(self) -> tuple[str, str]:
        """Kind of the daemon, and whose it is; empty = everybody's."""
        kind, _, subject = self.daemon.replace(":", " ", 1).partition(" ")
        return kind, subject

    def hits(self, process: Process) -> bool:
        """Whether a process is killed by this."""
        kind, subject = self.parts
        return process.kind.name == kind and subject in ("", process.board, *process.subject.split())

    def __str__(self) -> str:
        return f"{self.at:.1f} s: {self.daemon} is killed"


class BoardDown(_Fault, frozen=True, kw_only=True, tag="board_down"):
    """All daemons of a board die, and are started again when the board is back."""

    board: str
    seconds: Seconds

    def __str__(self) -> str:
        return f"{self.at:.1f} s: board {self.board} dies, and is back after {self.seconds:.1f} s"


class DiskFull(_Fault, frozen=True, kw_only=True, tag="disk_full"):
    """The disk of a board is full: its daemons can change nothing in their databases."""

    board: str
    seconds: Seconds

    def __str__(self) -> str:
        return f"{self.at:.1f} s: the disk of {self.board} is full for {self.seconds:.1f} s"


class ClockStep(_Fault, frozen=True, kw_only=True, tag="clock_step"):
    """The wall clock of a board is set: its daemons see another time from now on."""

    board: str
    by: float
    """Seconds forward; backward if negative."""

    def __str__(self) -> str:
        return f"{self.at:.1f} s: the clock of {self.board} is set by {self.by:+.1f} s"


class LinkCut(_Fault, frozen=True, kw_only=True, tag="link_cut"):
    """Nothing passes from one board to another; with `both`, in neither direction."""

    sender: str
    receiver: str
    seconds: Seconds
    both: bool = True

    def __str__(self) -> str:
        way = "between" if self.both else "one way from"
        return f"{self.at:.1f} s: no link {way} {self.sender} and {self.receiver} for {self.seconds:.1f} s"


class LinkNoise(_Fault, frozen=True, kw_only=True, tag="link_noise"):
    """A bad link between two boards: it delivers late, and in bursts of loss not before they are over."""

    sender: str
    receiver: str
    seconds: Seconds
    delay: Seconds
    """Seconds that a message needs more, on average; exponentially distributed."""
    bursts: Annotated[float, msgspec.Meta(ge=0)] = 0.0
    """Bursts of loss in a minute."""

    def __str__(self) -> str:
        late = f"{self.delay:.3f} s late and {self.bursts:.1f} bursts of loss a minute"
        return f"{self.at:.1f} s: {late} between {self.sender} and {self.receiver} for {self.seconds:.1f} s"


class Vehicle(_Fault, frozen=True, kw_only=True, tag="vehicle"):
    """What is wrong with a simulated vehicle and its link, as `bridged simulate --fault` has it."""

    robot: str
    fault: str

    def __str__(self) -> str:
        return f"{self.robot}: {self.fault}"


class Battery(_Fault, frozen=True, kw_only=True, tag="battery"):
    """A full battery of a simulated vehicle lasts so long in the air."""

    robot: str
    minutes: Annotated[float, msgspec.Meta(gt=0)]

    def __str__(self) -> str:
        return f"{self.robot}: a full battery lasts {self.minutes:.1f} min"


class Operator(_Fault, frozen=True, kw_only=True, tag="operator"):
    """An operator orders a robot as `argosy stop` does, until it has confirmed; later he gives it back."""

    order: StopOrder
    robot: str = ""
    """Empty: all robots."""
    seconds: Seconds | None = None
    """After its confirmation the robot is released, or ordered to continue; None: never."""

    def __str__(self) -> str:
        end = "" if self.seconds is None else f", and gives it back {self.seconds:.1f} s later"
        return f"{self.at:.1f} s: the operator orders {self.robot or 'every robot'} to {self.order}{end}"


Fault: TypeAlias = Operator | Kill | BoardDown | DiskFull | ClockStep | LinkCut | LinkNoise | Vehicle | Battery


def draw(mission: Mission, seed: int) -> list[Fault]:
    """Draw the standard faults of one run, in the order of their times."""
    dice = random.Random(f"argosy faults {seed}")
    boards, robots = mission.board_names, [name for name, one in mission.robots.items() if vehicle_of(one)]
    copters = [name for name in robots if vehicle_of(mission.robots[name]) == "copter"]
    found: list[Fault] = []

    def times() -> list[float]:
        """When a kind of fault happens: mostly never, else one to three times."""
        wanted = dice.random() < SHARE
        return [round(dice.uniform(2, STORM), 1) for _ in range(dice.randint(1, 3))] if wanted else []

    daemons = [f"commd {board}" if len(boards) > 1 else "commd" for board in boards]
    for at in times():
        found.append(Kill(at=at, daemon=dice.choice(daemons)))
    for kind, subjects in (("bridged", robots), ("agentd", mission.boards_with_agents)):
        for at in times() if subjects else ():
            found.append(Kill(at=at, daemon=f"{kind}:{dice.choice(subjects)}"))
    for at in times():
        found.append(BoardDown(at=at, board=dice.choice(boards), seconds=round(dice.uniform(1, 30), 1)))
    if len(boards) > 1:
        for at in times():
            sender, receiver = dice.sample(boards, 2)
            seconds = round(min(60.0, dice.expovariate(1 / 8)), 1)
            found.append(LinkCut(at=at, sender=sender, receiver=receiver, seconds=seconds, both=dice.random() < 0.5))
    for robot in copters:
        if dice.random() < SHARE:
            found.append(Vehicle(robot=robot, fault=f"loss={round(dice.uniform(0.01, 0.3), 2)}"))
        if dice.random() < SHARE / 2:
            found.append(Vehicle(robot=robot, fault=f"duplicate={round(dice.uniform(0.01, 0.2), 2)}"))
        for at in times():
            found.append(Vehicle(robot=robot, fault=f"cut={at:g}+{round(dice.uniform(0.5, 20), 1):g}"))
        found.append(Vehicle(robot=robot, fault=f"seed={dice.randrange(1, 1 << 30)}"))
    for robot in copters:
        if dice.random() < MUTE:
            found.append(Vehicle(robot=robot, fault="mute-acks"))
        simulate = mission.robots[robot].simulate
        if simulate is not None and simulate.battery is not None and dice.random() < SHARE:
            minutes = simulate.battery / 60 * dice.uniform(WORST_BATTERY, 1)
            found.append(Battery(robot=robot, minutes=round(minutes, 2)))
    for at in times():
        found.append(DiskFull(at=at, board=dice.choice(boards), seconds=round(dice.uniform(1, 20), 1)))
    if dice.random() < SHARE:
        speed, bearing = dice.uniform(2, 12), dice.uniform(0, 359)
        for robot in copters:  # all of them are in one place
            found.append(
                Vehicle(robot=robot, fault=f"wind={speed:.1f}:{bearing:.0f}:{speed * dice.uniform(0.1, 0.4):.1f}")
            )
    for robot in copters:
        metres, lands = f":{dice.uniform(1, 60):.0f}", dice.choice(("", ":lands"))
        for fault, more in (("gps-loss", ""), ("gps-jump", metres), ("pilot", lands)):
            if dice.random() < RARE:
                at, seconds = dice.uniform(2, STORM), dice.uniform(2, 30)
                found.append(Vehicle(robot=robot, fault=f"{fault}={at:.1f}+{seconds:.1f}{more}"))
    if dice.random() < RARE:
        at, seconds = round(dice.uniform(2, STORM), 1), round(dice.uniform(5, 60), 1)
        orders: Sequence[StopOrder] = get_args(StopOrder) if copters else ("hold", "pause")
        found.append(Operator(at=at, order=dice.choice(orders), robot=dice.choice(["", *robots]), seconds=seconds))
    for at in times():
        by = round(dice.choice((-1, 1)) * 10 ** dice.uniform(-1, 5), 1)
        found.append(ClockStep(at=at, board=dice.choice(boards), by=by))
    if len(boards) > 1:
        for at in times():
            sender, receiver = dice.sample(boards, 2)
            seconds, delay = round(dice.uniform(5, 60), 1), round(10 ** dice.uniform(-2.5, -0.3), 3)
            bursts = round(dice.uniform(0, 30), 1)
            found.append(
                LinkNoise(at=at, sender=sender, receiver=receiver, seconds=seconds, delay=delay, bursts=bursts)
            )
    for robot in copters:
        simulate = mission.robots[robot].simulate
        if simulate is not None and simulate.camera is not None and dice.random() < SHARE / 2:
            found.append(Vehicle(robot=robot, fault=f"camera={dice.uniform(0.5, 1):.2f}"))
    return sorted(found, key=lambda one: one.at)


def read(path: Path, mission: Mission) -> list[Fault]:
    """Read a YAML list of faults. Raises Findings that say what is wrong with it, or is not in the mission."""
    raw, positions = read_yaml(read_text(path), str(path))
    if not isinstance(raw, list):
        raise Findings(
            [positions.finding((), "expected a list of faults such as `- {kind: kill, daemon: commd, at: 5}`")]
        )
    faults, wrong = convert(raw, list[Fault], positions, decode_hook)
    for index, fault in enumerate(faults or ()):
        try:
            _check(fault, mission)
        except ValueError as error:
            wrong.append(positions.finding((index,), str(error)))
    if faults is None or wrong:
        raise Findings(wrong)
    return sorted(faults, key=lambda one: one.at)


def _check(fault: Fault, mission: Mission) -> None:
    """Raise ValueError if a fault names what the mission does not have."""
    robots = list(mission.robots)
    vehicles = [name for name, one in mission.robots.items() if vehicle_of(one) in ON_MAVLINK]
    match fault:
        case LinkCut() | LinkNoise():
            _expect(fault.sender, mission.board_names)
            _expect(fault.receiver, mission.board_names)
        case BoardDown() | DiskFull() | ClockStep():
            _expect(fault.board, mission.board_names)
        case Vehicle():
            _expect(fault.robot, vehicles)
            Faults.parse([fault.fault])
        case Battery():
            _expect(fault.robot, vehicles)
        case Operator() if not robots:
            raise ValueError("the mission has no robot for an order")
        case Operator():
            _expect(fault.robot or robots[0], robots)
        case Kill():
            kind, subject = fault.parts
            _expect(kind, ("commd", "bridged", "agentd"))
            if subject:
                _expect(subject, {*mission.board_names, *mission.robots, *mission.agents})


def _expect(name: str, known: Collection[str]) -> None:
    if name not in known:
        raise ValueError(f"expected {', '.join(sorted(known))}, got `{name}`")


def last(faults: Sequence[Fault]) -> float:
    """Return when the storm is over, in virtual seconds after the start."""
    ends = [one.at + (getattr(one, "seconds", None) or 0.0) for one in faults if math.isfinite(one.at)]
    return max(ends, default=0.0)
