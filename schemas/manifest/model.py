"""What a manifest holds (design section 12): a robot, its percepts and its actions, and how each is translated.

A manifest is data: it names sources, fields, commands and ranges from closed vocabularies, and nothing in it is
executed. Which sources, commands and confirmations exist is the driver's to say (`bridged.drivers`).
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
"""An argument of an action after it was checked: lists hold values, lists, or structures (`dict` by name)."""
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
    """What a number is multiplied by: 0.001 makes metres of millimetres. In a list, each of its numbers."""
    offset: Factor = 0.0
    """What is added then."""
    absent: Factor | None = None
    """The raw value by which the robot says that it does not know (65535, -1): then there is no percept, or this
    element of a list is left out."""
    each: tuple[str | Field, ...] = ()
    """The field is a list of structures: of each element these fields, as a list; the paper's `status[](key, value)`.
    A single one is not wrapped into a list of its own."""

    def parts(self) -> tuple[Field, ...]:
        """What is taken of each element, in the long form."""
        return _long(self.each)


class PerceptEntry(_Entry, frozen=True, kw_only=True):
    """How one percept is made from what the robot says."""

    source: str
    """Where the driver has it from: a message such as `GLOBAL_POSITION_INT`, a Zenoh key, a function's name."""
    driver: str = ""
    """The driver of this percept, if it is not the robot's."""
    args: tuple[str | Field, ...] = ()
    """The arguments of the belief in their order: fields of the message, bare or with their conversion."""
    buf: Literal["update", "add"] = "update"
    """`update` replaces the belief, `add` keeps every one (events)."""
    key: tuple[Annotated[int, Meta(ge=0)], ...] = ()
    """Positions of the arguments that tell beliefs of this name apart; none = there is one."""
    rate: Positive | None = None
    """At most so many changes a second are told; also what a stream of the source is asked for."""
    ttl: Duration | None = None
    """The belief goes when its source has been silent for so long; none = it stays."""
    deadband: Annotated[float, Meta(ge=0, le=1e15)] = 0.0
    """Numbers that moved by no more than this, in the unit of the percept, are not a change; those in lists too."""

    @property
    def arity(self) -> int:
        """Number of arguments of the belief."""
        return len(self.args)

    def fields(self) -> tuple[Field, ...]:
        """The arguments in their long form."""
        return _long(self.args)


def _long(fields: tuple[str | Field, ...]) -> tuple[Field, ...]:
    return tuple(Field(field=one) if isinstance(one, str) else one for one in fields)


class Parameter(_Entry, frozen=True, kw_only=True):
    """An argument of an action: what it must be."""

    name: str
    """How `fields`, errors and drivers call it."""
    type: ParameterType | tuple[ParameterType, ...] = "float"
    """What it must be; of several types the first that fits."""
    unit: str = ""
    """For people: it stands in errors and descriptions."""
    min: float | None = None
    """Smallest number that is taken."""
    max: float | None = None
    """Largest number that is taken."""
    each: tuple[Parameter, ...] = ()
    """Of type `list`: what each element holds, in this order; the paper's `Type[](a, b)`. An element is a list itself,
    or the bare value where it holds a single one. None of them: any list."""
    default: Value | None = None
    """The value where the agent leaves the argument out; arguments that have one are the last."""

    @property
    def types(self) -> tuple[ParameterType, ...]:
        """The types of which the argument must have one."""
        return (self.type,) if isinstance(self.type, str) else self.type

    def __str__(self) -> str:
        text = f"{self.name}: {self.expected()}"
        return text if self.default is None else f"{text} = {msgspec.json.encode(self.default).decode()}"

    def expected(self) -> str:
        """What the argument must be, for people: `float 1..120 m`, `list of [x: float, y: float]`."""
        text = " or ".join(self.types)
        if self.each:
            text += f" of [{', '.join(map(str, self.each))}]"
        if self.min is not None or self.max is not None:
            low = "" if self.min is None else f"{self.min:g}"
            high = "" if self.max is None else f"{self.max:g}"
            text += f" {low}..{high}"
        return f"{text} {self.unit}".rstrip()


class FieldValue(_Entry, frozen=True, kw_only=True):
    """What goes into a field of a command: an argument of the action, converted, or a constant."""

    param: str = ""
    """The argument that goes there."""
    value: Value | None = None
    """A constant instead of an argument; a text needs this form, a number may stand by itself."""
    scale: Factor = 1.0
    """What the argument is multiplied by: 1e7 makes MAVLink's integers of degrees."""
    offset: Factor = 0.0
    """What is added then."""
    table: str = ""
    """The argument is looked up in this table of the driver, such as `modes`."""

    @classmethod
    def written_out(cls, said: bool | int | float | str | FieldValue) -> FieldValue:
        """Return the long form of a field: a text names a parameter, another bare value is a constant."""
        match said:
            case FieldValue():
                return said
            case str():
                return cls(param=said)
        return cls(value=said)


class Retry(_Entry, frozen=True, kw_only=True):
    """How often a command is sent again when nothing answers. Wall seconds: they do not shrink with `speed`."""

    times: Annotated[int, Meta(ge=0, le=20)] = 3
    """How often, after the first time."""
    every: Duration = Duration(0.7)
    """How long an answer is waited for each time."""


class ActionEntry(_Entry, frozen=True, kw_only=True):
    """How one action is carried out, and how its success is known."""

    driver: str = ""
    """The driver of this action, if it is not the robot's."""
    params: tuple[Parameter, ...] = ()
    """The arguments in their order."""
    command: str = ""
    """MAVLink command, such as `MAV_CMD_NAV_TAKEOFF`."""
    message: str = ""
    """MAVLink message to send instead of a command, such as `SET_POSITION_TARGET_GLOBAL_INT`."""
    topic: str = ""
    """Zenoh key to put to."""
    service: str = ""
    """Zenoh key to ask."""
    call: str = ""
    """What the driver calls by a name of its own: a procedure such as `mission_upload`, a function of a plug-in."""
    frame: Literal["relative", "amsl", "local", "body"] | None = None
    """What an altitude counts from: home (`relative`), or mean sea level (`amsl`); what metres and m/s count along:
    north, east and down (`local`), or forward, right and down (`body`)."""
    fields: dict[str, Value | FieldValue] = {}
    """Fields of the command or message: a parameter's name, a number, or a conversion."""
    confirm: str = ""
    """By which state of the robot success is known; one of those that the driver offers."""
    feedback: tuple[str, ...] | None = None
    """Which figures of its progress the agent perceives as `feedback(Action, What, Value)` while it runs; none named =
    all that the driver tells, an empty list = none of them."""
    latch: bool = False
    """Whoever subscribes to the topic later is given the last value too."""
    tolerance: Positive | None = None
    """How near is there, in metres; none = the confirmation's own."""
    deadline: Duration = Duration(60)
    """Mission time after which it is given up and ends as `timed_out`."""
    retry: Retry = Retry()
    """How often the command is sent again when nothing answers."""
    cancel: Literal["hold", "none"] = "none"
    """What the robot does when the action is cancelled or out of time; `none` = it goes on."""
    motion: bool = True
    """It moves the robot: one such action at a time."""
    supersedes: bool = False
    """It ends a motion that is running instead of being refused as busy."""

    @property
    def arity(self) -> int:
        """Number of arguments, those that may be left out included."""
        return len(self.params)

    @property
    def arities(self) -> int | range:
        """The numbers of arguments that it takes: several, if some have a default."""
        least = sum(parameter.default is None for parameter in self.params)
        return self.arity if least == self.arity else range(least, self.arity + 1)

    def ways(self) -> dict[str, str]:
        """By which of the ways that exclude one another it is carried out: there must be one."""
        return {name: said for name in WAYS if (said := getattr(self, name))}


class RobotEntry(_Entry, frozen=True, kw_only=True):
    """What kind of robot this is."""

    driver: str
    """How the robot is talked to: `mavlink`, `zenoh`, `python`, or a package's own (docs/guides/drivers.md)."""
    vehicle: str = ""
    """Which of the driver's vehicle tables holds, such as `arducopter`."""
    link_loss: Duration = Duration(5)
    """Silence after which the robot counts as not connected; wall seconds at least."""
    values: Values = "typed"
    """`text`: percepts and arguments are read and written as the paper's bridge did, by way of their text
    (docs/reference/manifests.md)."""
    payload: str = ""
    """What a robot on Zenoh speaks where its samples' Encoding does not say it: `json` or `msgpack`; none = JSON."""


class Manifest(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A robot, declaratively. Made by `load_manifest`."""

    robot: RobotEntry
    percepts: dict[str, PerceptEntry] = {}
    actions: dict[str, ActionEntry] = {}
    orders: dict[Order, str] = {}
    """For a robot that knows no such modes itself: the action, with its arguments as a term, that carries out an order
    from above the agents, such as `hold = "cmd_vel(0, 0, 0)"`."""
    file: str = ""
    percepts_file: str = ""
    """The file of the percepts if it is another one, as in the paper's pair."""
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
        """Each percept's name and number of arguments."""
        return {name: entry.arity for name, entry in self.percepts.items()}

    def action_arities(self) -> dict[str, int | range]:
        """Each action's name and the numbers of arguments that it takes."""
        return {name: entry.arities for name, entry in self.actions.items()}


class ActionDescription(Record, frozen=True, kw_only=True):
    """What a bridge answers to a query for an action that is not a request to act: what the action is."""

    name: str
    signature: str
    """Such as `takeoff(altitude: float 1..120 m)`."""
    confirm: str = ""
    deadline: float = 0.0
    """Mission seconds."""
    problem: str = ""
    """What was wrong with the payload of the query."""
