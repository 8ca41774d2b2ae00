"""Faults on demand: what a bad link does to bytes, and what a bad vehicle does with messages.

Pure: bytes or messages and the time go in, what passes comes out. The process `bridged simulate copter --fault` and
the tests in virtual time use the same code. Dice are seeded, so that a run can be repeated.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.address import LinkAddress
from bridged.drivers.mavlink.transport.endpoint import Ids, Peer
from bridged.drivers.mavlink.transport.link import Link, MakeGate, OnPacket
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.motion.dynamics import Vector

HELD_S = 0.5
"""Vehicle seconds after which a delayed packet is delivered if no other one has overtaken it."""

LONGEST_GARBAGE = 40
"""Bytes."""

SEED = 1

_REQUESTS = frozenset(
    (
        dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
        dialect.MAV_CMD_GET_MESSAGE_INTERVAL,
        dialect.MAV_CMD_REQUEST_MESSAGE,
        dialect.MAV_CMD_GET_HOME_POSITION,
        dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
    )
)
"""Commands that only request messages: a lying vehicle obeys them, or nothing would be seen of it."""

_ACKNOWLEDGEMENTS = frozenset(("COMMAND_ACK", "MISSION_ACK"))
_IGNORED_BY_A_LIAR = frozenset(("SET_MODE", "SET_POSITION_TARGET_GLOBAL_INT", "SET_POSITION_TARGET_LOCAL_NED"))

Messages = list[dialect.MAVLink_message]


@dataclass(frozen=True, slots=True)
class Cut:
    """No bytes pass from `at` for `seconds`; vehicle seconds from the start of the simulation."""

    at: float
    seconds: float

    def covers(self, now: float) -> bool:
        """Return whether the link is cut at `now` vehicle seconds."""
        return self.at <= now < self.at + self.seconds


@dataclass(frozen=True, slots=True)
class WindFault:
    """Wind of `speed` m/s from `bearing` degrees; gusts deviate from it by `gust` m/s (standard deviation)."""

    speed: float
    bearing: float
    gust: float = 0.0


@dataclass(frozen=True, slots=True)
class GpsFault(Cut):
    """The GPS has no fix, or reports a place `metres` away."""

    metres: float | None = None


@dataclass(frozen=True, slots=True)
class PilotFault(Cut):
    """A pilot has the vehicle in the air; then he lands it, or gives it back in the mode in which it was."""

    lands: bool = False


@dataclass(frozen=True, slots=True)
class Faults:
    """Faults of a vehicle and its link; none by default. Shares are of the packets."""

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    garbage: float = 0.0
    mute_acks: bool = False
    lie: bool = False
    cuts: tuple[Cut, ...] = ()
    wind: WindFault | None = None
    gps: tuple[GpsFault, ...] = ()
    pilots: tuple[PilotFault, ...] = ()
    camera: float = 1.0
    reboots: tuple[float, ...] = ()
    autopilot: int | None = None
    prearm: tuple[tuple[float, str], ...] = ()
    """Arming checks that fail, each until a time."""
    seed: int = SEED

    @classmethod
    def parse(cls, texts: Iterable[str]) -> Faults:
        """Parse texts such as `loss=0.2,duplicate=0.1`. Raises ValueError with the expected forms."""
        faults = cls()
        for part in (part.strip() for text in texts for part in text.split(",")):
            name, equals, value = part.partition("=")
            row = TABLE.get(name)
            if row is None or bool(equals) != ("=" in row.form):
                forms = ", ".join(row.form for row in TABLE.values())
                raise ValueError(f"expected one of {forms}, got {part!r}")
            try:
                faults = row.add(faults, value)
            except ValueError:
                raise ValueError(f"expected {row.form} ({row.meaning}), got {part!r}") from None
        return faults

    def gps_error(self, now: float) -> Vector | None:
        """Return by how many metres the GPS is wrong at `now` vehicle seconds; None: it has no fix."""
        for fault in self.gps:
            if fault.covers(now):
                if fault.metres is None:
                    return None
                direction = random.Random(f"{self.seed} gps {fault.at}").uniform(0, 2 * math.pi)
                return Vector(fault.metres * math.cos(direction), fault.metres * math.sin(direction))
        return Vector()

    @property
    def on_links(self) -> bool:
        """Whether anything is wrong with the links."""
        return bool(self.cuts or self.loss or self.duplicate or self.reorder or self.garbage)

    def silent(self, now: float) -> bool:
        """Return whether the link is cut at `now` vehicle seconds."""
        return any(cut.covers(now) for cut in self.cuts)


@dataclass(frozen=True, slots=True)
class Row:
    """One kind of fault: its form on the command line and its meaning."""

    form: str
    meaning: str
    add: Callable[[Faults, str], Faults]


def _share(field: str) -> Callable[[Faults, str], Faults]:
    def add(faults: Faults, text: str) -> Faults:
        return replace(faults, **_one(field, _within(float(text), 1.0)))

    return add


def _flag(field: str) -> Callable[[Faults, str], Faults]:
    return lambda faults, _: replace(faults, **_one(field, True))


def _one(field: str, value: object) -> dict[str, Any]:
    return {field: value}


def _span(text: str) -> tuple[float, float]:
    """Read AT+SECONDS. Raises ValueError."""
    at, _, seconds = text.partition("+")
    return _within(float(at)), _within(float(seconds))


def _cut(faults: Faults, text: str) -> Faults:
    return replace(faults, cuts=(*faults.cuts, Cut(*_span(text))))


def _wind(faults: Faults, text: str) -> Faults:
    speed, bearing, gust = map(float, (text if text.count(":") > 1 else f"{text}:0").split(":"))
    return replace(faults, wind=WindFault(_within(speed, 40), _within(bearing, 360), _within(gust, 20)))


def _gps_loss(faults: Faults, text: str) -> Faults:
    return replace(faults, gps=(*faults.gps, GpsFault(*_span(text))))


def _gps_jump(faults: Faults, text: str) -> Faults:
    span, _, metres = text.partition(":")
    return replace(faults, gps=(*faults.gps, GpsFault(*_span(span), _within(float(metres), 10_000))))


def _pilot(faults: Faults, text: str) -> Faults:
    span, colon, lands = text.partition(":")
    if colon and lands != "lands":
        raise ValueError(text)
    return replace(faults, pilots=(*faults.pilots, PilotFault(*_span(span), bool(lands))))


def _prearm(faults: Faults, text: str) -> Faults:
    until, colon, message = text.partition(":")
    end, message = (_within(float(until)), message) if colon else (math.inf, text)
    if not message.strip():
        raise ValueError(text)
    return replace(faults, prearm=(*faults.prearm, (end, message.strip())))


def _reboot(faults: Faults, text: str) -> Faults:
    return replace(faults, reboots=tuple(sorted((*faults.reboots, _within(float(text))))))


def _within(value: float, most: float = 1e9) -> float:
    if not (math.isfinite(value) and 0 <= value <= most):
        raise ValueError(value)
    return value


TABLE: dict[str, Row] = {
    "loss": Row("loss=SHARE", "share (0 to 1) of packets that are lost, both ways", _share("loss")),
    "duplicate": Row("duplicate=SHARE", "share (0 to 1) of packets that arrive twice", _share("duplicate")),
    "reorder": Row("reorder=SHARE", "share (0 to 1) of packets that arrive after the following one", _share("reorder")),
    "garbage": Row(
        "garbage=SHARE", "share (0 to 1) of packets preceded by bytes that are no packet", _share("garbage")
    ),
    "mute-acks": Row("mute-acks", "the vehicle acts and never acknowledges", _flag("mute_acks")),
    "lie": Row("lie", "the vehicle acknowledges commands and obeys none; goals it ignores", _flag("lie")),
    "cut": Row("cut=AT+SECONDS", "nothing passes from AT for SECONDS of vehicle time", _cut),
    "wind": Row(
        "wind=SPEED:FROM[:GUST]",
        "wind of SPEED (0 to 40) m/s from FROM (0 to 360) degrees, its gusts deviate by GUST (0 to 20) m/s",
        _wind,
    ),
    "gps-loss": Row("gps-loss=AT+SECONDS", "the GPS has no fix from AT for SECONDS", _gps_loss),
    "gps-jump": Row(
        "gps-jump=AT+SECONDS:METRES",
        "the GPS is wrong by METRES (0 to 10000), in a direction by its dice, from AT for SECONDS",
        _gps_jump,
    ),
    "pilot": Row(
        "pilot=AT+SECONDS[:lands]",
        "from AT a pilot has it in LOITER when it is in the air; after SECONDS he gives it back, or lands it",
        _pilot,
    ),
    "camera": Row(
        "camera=SHARE", "share (0 to 1) of the victims within its range that its camera sees", _share("camera")
    ),
    "reboot": Row("reboot=AT", "the autopilot restarts at AT; in the air the motors stop", _reboot),
    "prearm": Row(
        "prearm=[UNTIL:]TEXT",
        "an arming check fails with this text, for ever or until UNTIL",
        _prearm,
    ),
    "autopilot": Row(
        "autopilot=N",
        "autopilot number (0 to 255) in its HEARTBEATs (12: PX4); it behaves as an ArduCopter",
        lambda f, text: replace(f, autopilot=int(_within(int(text), 255))),
    ),
    "seed": Row("seed=N", f"another row of dice (default {SEED})", lambda f, text: replace(f, seed=int(text))),
}
"""All faults by name."""


@dataclass(slots=True)
class LinkFaultCounters:
    """Counters of the packets of one direction."""

    passed: int = 0  # as they were, in their turn or late
    lost: int = 0
    duplicated: int = 0
    reordered: int = 0
    garbage: int = 0  # times that noise came between packets


class LinkFaults:
    """One direction of a link with faults."""

    def __init__(self, faults: Faults, direction: str) -> None:
        """`direction` seeds the random sequence of this way."""
        self.counters = LinkFaultCounters()
        self._faults = faults
        self._dice = random.Random(f"{faults.seed} {direction}")
        self._held: bytes | None = None
        self._held_until = 0.0

    def carry(self, packet: bytes, now: float) -> list[bytes]:
        """Return the output for one packet, datagram or piece of a stream; `now` in vehicle seconds."""
        faults, counters = self._faults, self.counters
        if faults.silent(now):
            counters.lost += 1
            return self.due(now)
        if self._happens(faults.loss):
            counters.lost += 1
            return self.due(now)
        if self._held is None and self._happens(faults.reorder):
            self._held, self._held_until = packet, now + HELD_S
            counters.reordered += 1
            return []
        out = []
        if self._happens(faults.garbage):
            out.append(self._noise())
        out.append(packet)
        counters.passed += 1
        if self._happens(faults.duplicate):
            out.append(packet)
            counters.duplicated += 1
        return out + self._release()

    def due(self, now: float) -> list[bytes]:
        """Return the delayed packet when it is due; call it now and then. `now`: vehicle seconds."""
        if self._held is None or now < self._held_until:
            return []
        if self._faults.silent(now):
            self._held = None
            self.counters.lost += 1
            return []
        return self._release()

    def _release(self) -> list[bytes]:
        held, self._held = self._held, None
        if held is None:
            return []
        self.counters.passed += 1
        return [held]

    def _happens(self, share: float) -> bool:
        return share > 0 and self._dice.random() < share

    def _noise(self) -> bytes:
        self.counters.garbage += 1
        noise = self._dice.randbytes(self._dice.randint(1, LONGEST_GARBAGE))
        # Half of it begins as a packet would: the worst that can precede one.
        return noise if self._dice.random() < 0.5 else bytes([dialect.PROTOCOL_MARKER_V2]) + noise


class VehicleFaults:
    """Faults in a vehicle's handling of messages."""

    def __init__(
        self,
        faults: Faults,
        piloted: IntEnum = Mode.LOITER,
        landing: IntEnum = Mode.LAND,
        given_back: IntEnum | None = None,
    ) -> None:
        """`piloted`, `landing` and `given_back` are the modes that a pilot sets: see `Autopilot`."""
        self._faults = faults
        self._piloted, self._landing, self._given_back = piloted, landing, given_back
        self._reboots = list(faults.reboots)
        self._has_it: tuple[PilotFault, int] | None = None
        """The pilot who has it, and the mode in which it was."""
        self.switch: IntEnum | None = None
        """The mode that the pilot who has it has set; None: no pilot has it."""
        self.landed = False
        """Whether a pilot has landed it: not where a failsafe did, out of his mode."""

    def false_reply(self, message: dialect.MAVLink_message) -> Messages | None:
        """Return a lying vehicle's answer to a message that it ignores; None if it accepts the message."""
        if not self._faults.lie:
            return None
        kind = message.get_type()
        if kind in _IGNORED_BY_A_LIAR:
            return []
        if kind in ("COMMAND_LONG", "COMMAND_INT") and message.command not in _REQUESTS:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            return [dialect.MAVLink_command_ack_message(message.command, dialect.MAV_RESULT_ACCEPTED, 0, 0, *sender)]
        return None

    def applied_to(self, messages: Messages) -> Messages:
        """Return the vehicle's messages with the faults applied."""
        if self._faults.autopilot is not None:
            for message in messages:
                if message.get_type() == "HEARTBEAT":
                    message.autopilot = self._faults.autopilot
        if not self._faults.mute_acks:
            return messages
        return [message for message in messages if message.get_type() not in _ACKNOWLEDGEMENTS]

    def failing_check(self, now: float) -> str:
        """Return the arming check that fails by a fault, in the vehicle's words; empty = none."""
        return next((message for until, message in self._faults.prearm if now < until), "")

    def switched_mode(self, now: float, mode: int, *, airborne: bool) -> int | None:
        """Return the mode that a pilot sets by his switch at `now` vehicle seconds; `mode`: the present one."""
        if self._has_it is not None:
            pilot, before = self._has_it
            if pilot.covers(now):
                return None
            if pilot.lands and airborne:
                self.switch = self._landing
                return self.switch
            self.landed |= self.switch is self._landing
            self._has_it = self.switch = None
            if pilot.lands:
                return None
            return before if self._given_back is None else self._given_back
        taking = next((one for one in self._faults.pilots if one.covers(now)), None)
        if taking is None or not airborne:
            return None
        self._has_it, self.switch = (taking, mode), self._piloted
        return self.switch

    def restarts(self, now: float) -> bool:
        """Return whether the vehicle restarts at `now` vehicle seconds; True once for each configured time."""
        if self._reboots and now >= self._reboots[0]:
            del self._reboots[0]
            return True
        return False


class FaultyLink(Link):
    """A link with faults in both directions. Each peer has its own random sequence, by the order of arrival."""

    def __init__(
        self,
        address: LinkAddress,
        on_packet: OnPacket,
        ids: Ids,
        make_gate: MakeGate | None,
        faults: Faults,
        now: Callable[[], float],
    ) -> None:
        """`now` returns vehicle seconds since the start of the simulation."""
        super().__init__(address, on_packet, ids, None, None, make_gate)
        self._faults = faults
        self._now = now
        self._count = 0
        self._down: list[tuple[LinkFaults, Callable[[bytes], bool]]] = []
        self._up: dict[Peer, tuple[LinkFaults, bool]] = {}

    def add_peer(self, key: object, label: str, write: Callable[[bytes], bool]) -> Peer:
        """Add a peer whose output passes through the faults; called by endpoints."""
        if not self._faults.on_links:
            return super().add_peer(key, label, write)
        self._count += 1
        air = LinkFaults(self._faults, f"down {self._count}")
        self._down.append((air, write))

        def through_air(packet: bytes) -> bool:
            written = [write(piece) for piece in air.carry(packet, self._now())]
            return all(written)

        peer = super().add_peer(key, label, through_air)
        self._up[peer] = (LinkFaults(self._faults, f"up {self._count}"), True)
        return peer

    def report(self) -> str:
        """Return the counts of refused and faulty packets since the link was opened, as text; empty if none."""
        airs = [air for air, _ in self._down] + [air for air, _ in self._up.values()]
        counts = {
            "refused for want of a right signature": self.counters.refused,
            "lost": sum(air.counters.lost for air in airs),
            "doubled": sum(air.counters.duplicated for air in airs),
            "late": sum(air.counters.reordered for air in airs),
            "bursts of garbage": sum(air.counters.garbage for air in airs),
        }
        return ", ".join(f"{count} {what}" for what, count in counts.items() if count)

    def drop_peer(self, key: object) -> None:
        """Remove a peer; called by endpoints."""
        peer = self.peers_by_key.get(key)
        super().drop_peer(key)
        if peer in self._up:
            at = list(self._up).index(peer)
            del self._up[peer], self._down[at]

    def received(self, peer: Peer, data: bytes, *, datagram: bool) -> None:
        """Take input through the faults; called by endpoints."""
        if not self._faults.on_links:
            super().received(peer, data, datagram=datagram)
            return
        air, _ = self._up[peer]
        self._up[peer] = (air, datagram)
        for piece in air.carry(data, self._now()):
            super().received(peer, piece, datagram=datagram)

    def deliver_late(self) -> None:
        """Deliver delayed packets that are due; call it now and then."""
        now = self._now()
        for air, write in self._down:
            for packet in air.due(now):
                write(packet)
        for peer, (air, datagram) in list(self._up.items()):
            for piece in air.due(now):
                super().received(peer, piece, datagram=datagram)
