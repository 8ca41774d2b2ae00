"""The doctor's checks of robots: how much is heard of a vehicle, and which percepts are missing."""

from __future__ import annotations

from argosy.cli.remedies import REMEDIES
from argosy.doctor.findings import Facts, RobotFacts, Said
from argosy.fleet_model.fleet_status import Row
from schemas.humanize import count
from schemas.wire.records import Health

FEW = 5.0
"""Messages a second below which a vehicle's streams are not what the manifest asks for."""
NOISE = 0.01
"""Share of packets that came damaged."""


def vehicles(facts: Facts) -> list[Said]:
    """How many messages a second come from each vehicle, and how many of them damaged."""
    said: list[Said] = []
    for name, before, after in _bridges(facts):
        took = after.uptime - before.uptime
        if "messages" not in after.counters or took <= 0 or before.header.boot != after.header.boot:
            continue
        link = facts.mission.robots[name].link
        came = (after.counters["messages"] - before.counters.get("messages", 0)) / took
        bad = (after.counters.get("bad_checksums", 0) - before.counters.get("bad_checksums", 0)) / took
        do = f"is the vehicle on, and does it send to `{link}`? baud rate, cable, SRn_ parameters of the port"
        if came == 0:
            said.append(Said("error", "vehicles", f"{name}: nothing is heard on {link}", do))
        elif came < FEW:
            said.append(Said("warning", "vehicles", f"{name}: only {came:.1f} messages/s on {link}", do))
        elif bad > NOISE * came:
            text = f"{name}: {bad:.1f} of {came + bad:.0f} packets/s come damaged on {link}"
            said.append(
                Said("warning", "vehicles", text, "baud rate, cable, grounding; for a radio: distance and antennas")
            )
        else:
            said.append(Said("ok", "vehicles", f"{name}: {came:.0f} messages/s on {link}"))
    return said


def failsafes(facts: Facts) -> list[Said]:
    """Whose heartbeats the vehicles' own failsafes watch; those of which the mission does not say it together."""
    vehicles = {
        name: facts.mission.robots[name].failsafe.gcs for name, _, now in _bridges(facts) if "messages" in now.counters
    }
    said = [
        Said("ok", "failsafe", f"{name}: watches heartbeats of `{gcs}`")
        for name, gcs in vehicles.items()
        if gcs not in (None, "none")
    ]
    if undeclared := [name for name, gcs in vehicles.items() if gcs is None]:
        text = f"{', '.join(undeclared)}: none declared: if the bridge dies, nothing brings the vehicle home"
        said.append(Said("warning", "failsafe", text, REMEDIES["failsafe_none"]))
    return said


def percepts(facts: Facts) -> list[Said]:
    """Which percepts of the running manifests are not told. One whose source is silent for its `ttl` is not there; so
    those without a `ttl` (events, an override) may well be away.
    """
    said: list[Said] = []
    for robot, found in facts.robots.items():
        if found.problem:
            said.append(Said("warning", "percepts", f"{robot}: {found.problem}", "see `daemons`"))
            continue
        live = {name for name, entry in found.declared.items() if entry.get("ttl") is not None}
        missing = sorted(live - found.percepts.keys())
        if missing:
            sources = sorted({str(found.declared[name].get("source", "?")) for name in missing})
            text = f"{robot}: not told now: {', '.join(missing)} (from {', '.join(sources)})"
            do = (
                "does the robot send that? For ArduPilot: SRn_ parameters of the port; else take it out of the manifest"
            )
            said.append(Said("warning", "percepts", text, do))
        else:
            age = _newest(facts, robot, found)
            when = f", the newest told {max(0.0, age):.1f} s ago" if age is not None else ""
            said.append(Said("ok", "percepts", f"{robot}: {count(len(found.percepts), 'percept')}{when}"))
    return said


def _newest(facts: Facts, robot: str, found: RobotFacts) -> float | None:
    """Return the age of a robot's newest percept in seconds, by the clock of its board."""
    if not found.percepts:
        return None
    link = facts.from_here.get(facts.mission.robots[robot].board)
    ahead = link.ahead if link is not None and link.ahead is not None else 0.0
    return (facts.now - max(found.percepts.values())) / 1e9 + ahead


def _bridges(facts: Facts) -> list[tuple[str, Health, Health]]:
    """The robots whose bridge told how it is, at both times."""

    def told(rows: list[Row]) -> dict[str, Health]:
        return {row.name: row.now for row in rows if row.daemon == "bridged" and row.well and row.now is not None}

    before, after = told(list(facts.earlier)), told(list(facts.rows))
    return [(name, before[name], after[name]) for name in facts.mission.robots if name in before and name in after]
