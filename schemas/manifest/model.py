"""The model of a manifest (design section 12): a robot, its percepts and actions, and how each is translated.

A manifest is data: it names sources, fields, commands and ranges from closed vocabularies, and nothing in it is
executed. The drivers define which sources, commands and confirmations exist (`bridged.drivers`).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from schemas.files.findings import Finding
from schemas.files.toml_positions import line_of
from schemas.files.units import Duration
from schemas.wire.records import Order, Record

Positive = Annotated[float, Meta(gt=0, le=1e6)]
Factor = Annotated[float, Meta(ge=-1e15, le=1e15)]
ParameterType = Literal["float", "int", "boolean", "string", "list"]
Value = bool | int | float | str
Argument = Value | list[Any]
"""A checked argument of an action: lists hold values, lists, or structures (`dict` by name)."""
Values = Literal["typed", "text"]
WAYS = ("command", "message", "topic", "service", "call")
"""Fields of an action of which it has exactly one."""


class _Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """A table of the manifest: an unknown field is an error, so that a typing mistake cannot pass unnoticed."""


class Field(_Entry, frozen=True, kw_only=True):
    """A value in a message of the robot: `value * scale + offset`."""

    field: str
    """Path in the message, such as `voltages.0`."""
    scale: Factor = 1.0
    """Factor of a number, such as 0.001 from millimetres to metres; in a list, of each number."""
    offset: Factor = 0.0
    """Added after scaling."""
    absent: Factor | None = None
    """Raw value that means unknown, such as 65535 or -1: then there is no percept, or this element of a list is left
    out."""
    each: tuple[str | Field, ...] = ()
    """For a list of structures: the fields to take of each element, as a list (the paper's `status[](key, value)`).
    A single field is taken as a bare value."""

    def parts(self) -> tuple[Field, ...]:
        """Return `each` in the long form."""
        return _long(self.each)


class PerceptEntry(_Entry, frozen=True, kw_only=True):
    """One percept, and how it is made from the data of the robot."""

    source: str
    """Source in the driver: a message such as `GLOBAL_POSITION_INT`, a Zenoh key, or the name of a function."""
    driver: str = ""
    """The driver of this percept, if it is not the robot's."""
    args: tuple[str | Field, ...] = ()
    """Arguments of the belief, in order: fields of the message, bare or with a conversion."""
    buf: Literal["update", "add"] = "update"
    """`update` replaces the belief; `add` adds one each time (for events)."""
    key: tuple[Annotated[int, Meta(ge=0)], ...] = ()
    """Positions, from 0, of the arguments that identify a belief of this name; none = there is only one."""
    rate: Positive | None = None
    """Highest rate of changes, in Hz; also the rate requested of a stream of the source."""
    ttl: Duration | None = None
    """The belief is removed when its source has been silent for this long; none = it stays."""
    deadband: Annotated[float, Meta(ge=0, le=1e15)] = 0.0
    """A number that differs by no more than this, in the unit of the percept, is no change, also within a list."""
    optional: bool = False
    """Not every robot of this kind has the source: its absence is no warning."""

    @property
    def arity(self) -> int:
        """Number of arguments of the belief."""
        return len(self.args)

    def fields(self) -> tuple[Field, ...]:
        """Return the arguments in the long form."""
        return _long(self.args)


def _long(fields: tuple[str | Field, ...]) -> tuple[Field, ...]:
    return tuple(Field(field=one) if isinstance(one, str) else one for one in fields)


class Parameter(_Entry, frozen=True, kw_only=True):
    """A parameter of an action: type and range of its argument."""

    name: str
    """Its name in `fields`, errors and drivers."""
    type: ParameterType | tuple[ParameterType, ...] = "float"
    """Type of the argument; of several types, the first that fits."""
    unit: str = ""
    """For people: shown in errors and descriptions."""
    min: float | None = None
    """Smallest valid number, in `unit`."""
    max: float | None = None
    """Largest valid number, in `unit`."""
    each: tuple[Parameter, ...] = ()
    """For type `list`: the values of each element, in order (the paper's `Type[](a, b)`). An element is a list, or
    the bare value if it has only one. None = any list."""
    default: Value | None = None
    """Value if the agent leaves the argument out; parameters with a default are the last ones."""

    @property
    def types(self) -> tuple[ParameterType, ...]:
        """The types of which the argument must have one."""
        return (self.type,) if isinstance(self.type, str) else self.type

    def __str__(self) -> str:
        text = f"{self.name}: {self.expected()}"
        return text if self.default is None else f"{text} = {msgspec.json.encode(self.default).decode()}"

    def expected(self) -> str:
        """Return type and range, for people: `float 1..120 m`, `list of [x: float, y: float]`."""
        text = " or ".join(self.types)
        if self.each:
            text += f" of [{', '.join(map(str, self.each))}]"
        if self.min is not None or self.max is not None:
            low = "" if self.min is None else f"{self.min:g}"
            high = "" if self.max is None else f"{self.max:g}"
            text += f" {low}..{high}"
        return f"{text} {self.unit}".rstrip()


class FieldValue(_Entry, frozen=True, kw_only=True):
    """The value of a field of a command: an argument of the action, converted, or a constant."""

    param: str = ""
    """Name of the parameter whose argument it is."""
    value: Value | None = None
    """A constant instead of an argument. A text needs this form; a number may be given without it."""
    scale: Factor = 1.0
    """Factor of the argument, such as 1e7 from degrees to MAVLink's integers."""
    offset: Factor = 0.0
    """Added after scaling."""
    table: str = ""
    """The argument is looked up in this table of the driver, such as `modes`."""

    @classmethod
    def written_out(cls, value: bool | int | float | str | FieldValue) -> FieldValue:
        """Return the long form of a field: a text names a parameter, another bare value is a constant."""
        match value:
            case FieldValue():
                return value
            case str():
                return cls(param=value)
        return cls(value=value)


class Retry(_Entry, frozen=True, kw_only=True):
    """How a command is repeated when nothing answers, in wall seconds, whatever the `speed`."""

    times: Annotated[int, Meta(ge=0, le=20)] = 3
    """Number of repetitions, 0 to 20."""
    every: Duration = Duration(0.7)
    """Timeout of each attempt."""


class ActionEntry(_Entry, frozen=True, kw_only=True):
    """How one action is carried out, and how its success is known."""

    driver: str = ""
    """The driver of this action, if it is not the robot's."""
    params: tuple[Parameter, ...] = ()
    """Parameters, in order."""
    command: str = ""
    """MAVLink command, such as `MAV_CMD_NAV_TAKEOFF`."""
    message: str = ""
    """MAVLink message to send instead of a command, such as `SET_POSITION_TARGET_GLOBAL_INT`."""
    topic: str = ""
    """Zenoh key to publish on."""
    service: str = ""
    """Zenoh key to query."""
    call: str = ""
    """Name of a procedure of the driver, such as `mission_upload`, or of a function of a plug-in."""
    frame: Literal["relative", "amsl", "local", "body"] | None = None
    """Frame of its figures: altitudes above home (`relative`) or mean sea level (`amsl`); metres and m/s to the
    north, east and down (`local`), or forward, right and down (`body`)."""
    fields: dict[str, Value | FieldValue] = {}
    """Fields of the command or message: a parameter's name, a number, or a conversion."""
    confirm: str = ""
    """State of the robot that confirms success; one of those that the driver offers."""
    feedback: tuple[str, ...] | None = None
    """Figures of progress that the agent perceives as `feedback(Action, What, Value)` while it runs; none = all that
    the driver reports, an empty list = no figures."""
    latch: bool = False
    """Whether later subscribers of the topic get the last value too."""
    tolerance: Positive | None = None
    """Distance in metres at which a target counts as reached; none = the confirmation's own."""
    deadline: Duration = Duration(60)
    """Mission time, more than 0, after which it ends as `timed_out`."""
    retry: Retry = Retry()
    """How the command is repeated when nothing answers."""
    cancel: Literal["hold", "none"] = "none"
    """Effect of a cancellation or timeout on the robot; `none` = it continues."""
    motion: bool = True
    """Whether it moves the robot: one such action runs at a time."""
    supersedes: bool = False
    """Whether it ends a running motion instead of being refused as busy."""

    @property
    def arity(self) -> int:
        """Number of arguments, including optional ones."""
        return len(self.params)

    @property
    def arities(self) -> int | range:
        """Valid numbers of arguments: several, if some have a default."""
        least = sum(parameter.default is None for parameter in self.params)
        return self.arity if least == self.arity else range(least, self.arity + 1)

    def ways(self) -> dict[str, str]:
        """Return the given ones of `WAYS`, which exclude each other: there must be one."""
        return {name: value for name in WAYS if (value := getattr(self, name))}


class RobotEntry(_Entry, frozen=True, kw_only=True):
    """The robot: its driver and its kind."""

    driver: str
    """Driver: `mavlink`, `zenoh`, `python`, or that of another package (docs/guides/drivers.md)."""
    vehicle: str = ""
    """Vehicle table of the driver, such as `copter`."""
    link_loss: Duration = Duration(5)
    """Silence after which the robot counts as disconnected; wall seconds at least."""
    values: Values = "typed"
    """`text` = percepts and arguments are converted by way of their text, as in the paper's bridge
    (docs/reference/manifests.md)."""
    payload: str = ""
    """Payload format of a robot on Zenoh whose samples' Encoding does not name it: `json` or `msgpack`; none = JSON."""


class Manifest(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A robot, declaratively. Made by `load_manifest`."""

    robot: RobotEntry
    percepts: dict[str, PerceptEntry] = {}
    actions: dict[str, ActionEntry] = {}
    orders: dict[Order, str] = {}
    """For a robot without modes for orders: the action, with its arguments as a term, that carries out an order
    which overrides the agents, such as `hold = "cmd_vel(0, 0, 0)"`."""
    file: str = ""
    percepts_file: str = ""
    """The file of the percepts, if it is another one, as in the paper's pair."""
    lines: dict[tuple[str, ...], int] = {}

    def finding(self, message: str, *path: str) -> Finding:
        """Return a finding at the line of the table or key at `path`, such as `"actions", "takeoff", "confirm"`."""
        file = self.percepts_file if path[:1] == ("percepts",) and self.percepts_file else self.file
        return Finding(file, line_of(self.lines, path), 0, message)

    def driver_of(self, entry: PerceptEntry | ActionEntry) -> str:
        """Return the name of the driver of an entry."""
        return entry.driver or self.robot.driver

    def drivers(self) -> list[str]:
        """Return the drivers that the robot needs, its own first."""
        entries: list[PerceptEntry | ActionEntry] = [*self.percepts.values(), *self.actions.values()]
        return list(dict.fromkeys([self.robot.driver, *(self.driver_of(entry) for entry in entries)]))

    def part(self, driver: str) -> Manifest:
        """Return the manifest with the percepts and actions of one driver only."""
        return msgspec.structs.replace(
            self,
            percepts={name: entry for name, entry in self.percepts.items() if self.driver_of(entry) == driver},
            actions={name: entry for name, entry in self.actions.items() if self.driver_of(entry) == driver},
        )

    def percept_arities(self) -> dict[str, int]:
        """Return the number of arguments of each percept."""
        return {name: entry.arity for name, entry in self.percepts.items()}

    def action_arities(self) -> dict[str, int | range]:
        """Return the valid numbers of arguments of each action."""
        return {name: entry.arities for name, entry in self.actions.items()}


class ActionDescription(Record, frozen=True, kw_only=True):
    """A description of an action: the reply of a bridge to a query that is no request to act."""

    name: str
    signature: str
    """Such as `takeoff(altitude: float 1..120 m)`."""
    confirm: str = ""
    deadline: float = 0.0
    """Mission seconds."""
    problem: str = ""
    """The defect of the query's payload."""
