"""Checks of gathered facts: daemons, versions, clocks, disks, links, mail, vehicles, failsafes, percepts."""

from __future__ import annotations

from collections.abc import Iterator

from argosy.cli.remedies import REMEDIES, level_of, logs_of, target_of
from argosy.doctor.findings import Diagnosis, Facts, RobotFacts
from argosy.fleet_model.fleet_status import MEANING, Row
from schemas.humanize import count, latency, span
from schemas.liveness import LAG_LATE
from schemas.version import RELEASE
from schemas.wire.records import Health, LinkReport

CLOCK_WARNING, CLOCK_ERROR = 0.25, 30.0
"""Clock skew in seconds: logs of boards do not fit together; certificates seem expired or not yet valid."""
DISK_WARNING, DISK_ERROR = 1_000_000_000, 200_000_000
"""Free bytes for state."""
SLOW_TRIP = 0.5
"""Round trip in wall seconds that delays mail and actions noticeably."""
SLOW_RATE = 20_000.0
"""Rate in bytes/s that the percepts of one vehicle can use up."""
SENDS = {
    "mavlink": "does the robot send it? For ArduPilot: SRn_ parameters of the port",
    "zenoh": "does the robot put this key, with every field of the percept's `args`? See `daemons`, and read the key",
    "": "does its driver report this source, with every field of the percept's `args`? See `daemons`",
}
"""What to look at for missing percepts, by their driver; empty = any other one."""
MAIL_WAITS = 60.0
"""Wall seconds in a queue after which mail is reported."""


def daemons(facts: Facts) -> list[Diagnosis]:
    """Report daemons that are missing or hang, and the health notes of the others."""
    if not facts.rows:
        return [Diagnosis("error", "daemons", "no daemon is running", logs_of("commd", facts.mission, "each board"))]
    dark = _dark(facts)
    diagnoses: list[Diagnosis] = []
    for board in dark:
        its = ", ".join(f"{row.daemon} {row.name}" for row in facts.rows if row.board == board)
        do = f"is it switched on and in the network? {target_of(facts.mission, 'status', board)}"
        diagnoses.append(Diagnosis("error", "daemons", f"all daemons of {board} are missing: {its}", do))
    diagnoses += [_absent(facts, row) for row in facts.rows if not row.well and row.board not in dark]
    for row in facts.rows:
        diagnoses += _complaints(facts, row)
    strangers = [f"{row.daemon} {row.name}" for row in facts.rows if not row.in_mission and row.daemon != "agentd"]
    if strangers:
        do = "if it belongs to another mission, give that mission another `fleet`; else stop it"
        diagnoses.append(Diagnosis("warning", "daemons", f"not in the mission: {', '.join(strangers)}", do))
    if all(row.well for row in facts.rows):
        oldest = max((row.age or 0.0 for row in facts.rows), default=0.0)
        diagnoses.insert(0, Diagnosis("ok", "daemons", f"all {len(facts.rows)} are up, heard within {oldest:.1f} s"))
    return diagnoses


def _dark(facts: Facts) -> list[str]:
    """Return the boards with several daemons, all missing."""
    by_board: dict[str, list[Row]] = {}
    for row in facts.rows:
        by_board.setdefault(row.board, []).append(row)
    return [b for b, rows in by_board.items() if len(rows) > 1 and all(row.standing == "missing" for row in rows)]


def _absent(facts: Facts, row: Row) -> Diagnosis:
    do = {
        "silent": "it hangs, or its health is denied: restart it; ",
        "twice": "stop one of them: one runs on a board that the mission does not name; ",
        "unclaimed": "the access rules deny its token: write them again with `argosy units`; ",
    }.get(row.standing, "")
    place = row.board or "its board"
    return Diagnosis(
        "error",
        "daemons",
        f"{row.daemon} {row.name} on {place} is {row.standing}: {MEANING[row.standing]}",
        do + logs_of(row.daemon, facts.mission, place),
    )


def _complaints(facts: Facts, row: Row) -> Iterator[Diagnosis]:
    health = row.now
    if health is None:
        return
    who, logs = f"{row.daemon} {row.name}", logs_of(row.daemon, facts.mission, row.board or "its board")
    for note in health.notes:
        yield Diagnosis(level_of(note), "daemons", f"{who}: {note.text}", REMEDIES.get(note.code, logs))
    if health.restarts:
        was = f"; {health.last_error}" if health.last_error and health.last_error_age is None else ""
        text = f"{who} was restarted {count(health.restarts, 'time')} since its board started{was}"
        yield Diagnosis("warning", "daemons", text, logs)
    if health.last_error and health.last_error_age is not None:
        text = f"{who}: {count(health.errors, 'error')}, the last {health.last_error_age:.0f} s ago: "
        yield Diagnosis("warning", "daemons", text + health.last_error, logs)
    before = next((one.now for one in facts.earlier if (one.name, one.daemon) == (row.name, row.daemon)), None)
    if before is not None and before.header.boot == health.header.boot and health.drops > before.drops:
        text = f"{who} dropped {health.drops - before.drops} messages within {health.uptime - before.uptime:.0f} s"
        do = "it is overloaded: declare fewer percepts, or a lower `rate`, in the manifest"
        yield Diagnosis("warning", "daemons", text, do)
    if failed := round(health.counters.get("intentions_failed", 0)):
        text = f"{who}: {count(failed, 'intention')} ended by a failure that no plan handles"
        yield Diagnosis("warning", "daemons", text, f"`argosy why {row.name}` explains the last decisions; {logs}")
    if health.lag >= LAG_LATE:
        do = "reduce the board's load: fewer agents, lower rates, no plan that loops without a wait; `top` shows it"
        yield Diagnosis("warning", "daemons", f"{who} is {health.lag:.1f} s behind", do)


def versions(facts: Facts) -> list[Diagnosis]:
    """Report daemons with another version of Argosy than this machine's."""
    found: dict[str, list[str]] = {}
    for row in facts.rows:
        if row.now is not None:
            found.setdefault(row.now.version or "unknown, older", []).append(row.name)
    if not found:
        return []
    if list(found) == [RELEASE]:
        return [Diagnosis("ok", "versions", f"all run {RELEASE}, like this machine")]
    running = "; ".join(f"{version}: {', '.join(sorted(set(names)))}" for version, names in sorted(found.items()))
    majors = {version.partition(".")[0] for version in found if version[:1].isdigit()} | {RELEASE.partition(".")[0]}
    do = "install one version on all boards, one after the other (docs/guides/operations.md)"
    return [Diagnosis("error" if len(majors) > 1 else "warning", "versions", f"{running}; this machine: {RELEASE}", do)]


def clocks(facts: Facts) -> list[Diagnosis]:
    """Report clock skew between boards and this machine, measured by round trips."""
    seen = {board: link for board, link in facts.from_here.items() if link.ahead is not None}
    if not seen:
        return []
    offsets = [(link.ahead or 0.0, board, (link.round_trip or 0.0) / 2) for board, link in seen.items()]
    offsets.append((0.0, "this machine", 0.0))
    (low, behind, one), (high, ahead, other) = min(offsets), max(offsets)
    skew, unsure = high - low, one + other
    everybody = f"{count(len(seen), 'board')} and this machine"
    if skew - unsure < CLOCK_WARNING:
        return [Diagnosis("ok", "clocks", f"{everybody} agree within {latency(skew)} (measured to {latency(unsure)})")]
    level, why = ("warning", "times in logs and records do not fit together")
    if skew - unsure >= CLOCK_ERROR:
        level, why = ("error", "certificates seem expired or not yet valid")
    text = f"{ahead} is {latency(skew)} ahead of {behind} (measured to {latency(unsure)}): {why}"
    do = "let one board serve the time to the others (chrony or systemd-timesyncd); `timedatectl` shows the state"
    return [Diagnosis(level, "clocks", text, do)]  # type: ignore[arg-type]


def disks(facts: Facts) -> list[Diagnosis]:
    """Report disks with little space for mail, checkpoints and action logs."""
    diagnoses: list[Diagnosis] = []
    least: tuple[int, str] | None = None
    for board, report in facts.reports.items():
        free, size = report.disk_free, report.disk_size
        if free is None or size is None:
            diagnoses.append(
                Diagnosis("error", "disks", f"{board}: {report.state} cannot be read", f"on {board}: `df -h`")
            )
            continue
        least = min(least or (free, board), (free, board))
        if free < DISK_WARNING:
            text = f"{board}: {free / 1e6:.0f} MB of {size / 1e9:.1f} GB are free at {report.state}"
            level = "error" if free < DISK_ERROR else "warning"
            do = f"on {board}: `journalctl --vacuum-size=100M`; a full disk refuses mail"
            diagnoses.append(Diagnosis(level, "disks", text, do))  # type: ignore[arg-type]
    if least is not None and not diagnoses:
        diagnoses.append(Diagnosis("ok", "disks", f"at least {least[0] / 1e9:.1f} GB are free for state ({least[1]})"))
    return diagnoses


def links(facts: Facts) -> list[Diagnosis]:
    """Report links between boards, and from this machine, that are broken, late or slow."""
    diagnoses: list[Diagnosis] = []
    fine: list[LinkReport] = []
    there = {row.name for row in facts.rows if row.daemon == "commd" and row.well}
    for board, why in facts.boards.items():
        if isinstance(why, str) and board in there:
            text = f"{board} runs but answers no checkup: clock, disk and links are unknown ({why})"
            do = "use an operator's keys: observers get no answer"
            diagnoses.append(Diagnosis("warning", "links", text, do))
        elif isinstance(why, str):
            do = f"is it switched on and in the network? {logs_of('commd', facts.mission, board)}"
            diagnoses.append(Diagnosis("error", "links", f"{board} is not reached from here: {why}", do))
    pairs = [(board, link) for board, report in facts.reports.items() for link in report.links]
    pairs += [("this machine", link) for board, link in facts.from_here.items() if board in facts.reports]
    for board, link in pairs:
        found = _link(board, link)
        diagnoses += found
        if not found:
            fine.append(link)
    if fine and not diagnoses:
        slowest = max(link.round_trip or 0.0 for link in fine)
        rates = [link.rate for link in fine if link.rate is not None]
        rate = f", {min(rates) / 1000:.0f} kB/s at least" if rates else ""
        diagnoses.append(
            Diagnosis("ok", "links", f"{count(len(fine), 'way')} measured: {latency(slowest)} at most{rate}")
        )
    return diagnoses


def _link(board: str, link: LinkReport) -> list[Diagnosis]:
    way = f"{board} > {link.board}"
    look = f"is {link.board} in the network? `ping` its address from {board}; radio: distance, antennas, channel"
    if not link.answered:
        return [Diagnosis("error", "links", f"{way}: {link.problem}", look)]
    if link.answered < link.asked:
        text = f"{way}: {link.asked - link.answered} of {link.asked} round trips had no answer"
        return [Diagnosis("warning", "links", text, look)]
    if link.problem:
        return [Diagnosis("warning", "links", f"{way}: {link.problem}", look)]
    if link.round_trip is not None and link.round_trip > SLOW_TRIP:
        text = f"{way}: {latency(link.round_trip)} for a round trip at best, {latency(link.slowest or 0.0)} at worst"
        return [Diagnosis("warning", "links", text, look)]
    if link.rate is not None and link.rate < SLOW_RATE:
        text = f"{way}: {link.rate / 1000:.1f} kB/s"
        do = "send less: lower `rate` in the manifests, `wire: msgpack` in the mission; or improve the link"
        return [Diagnosis("warning", "links", text, do)]
    return []


def mail(facts: Facts) -> list[Diagnosis]:
    """Report mail that waits for long, and dead letters."""
    diagnoses: list[Diagnosis] = []
    for board, boxes in facts.mail.items():
        for queue in boxes.queues:
            if queue.oldest > MAIL_WAITS:
                who = f"{queue.sender} > {queue.receiver}"
                text = f"{board}: {count(queue.messages, 'message')} {who} wait, the oldest for {span(queue.oldest)}"
                text += f": {queue.state}" if queue.state else ""
                do = "delivery continues when the receiver is back: see `daemons` and `links`"
                diagnoses.append(Diagnosis("warning", "mail", text, do))
        if boxes.dead_count:
            text = f"{board}: {count(boxes.dead_count, 'message')} could not be delivered"
            diagnoses.append(Diagnosis("warning", "mail", text, f"see `argosy mail {facts.mission.path} --dead`"))
    if facts.mail and not diagnoses:
        diagnoses.append(Diagnosis("ok", "mail", f"no mail waits for long on {count(len(facts.mail), 'board')}"))
    return diagnoses


FEW = 5.0
"""Messages/s below which a vehicle does not send the streams that the manifest requests."""
NOISE = 0.01
"""Tolerated share of damaged packets."""


def vehicles(facts: Facts) -> list[Diagnosis]:
    """Report vehicles that send few messages, or damaged ones."""
    diagnoses: list[Diagnosis] = []
    for name, before, after in _bridges(facts):
        took = after.uptime - before.uptime
        if "messages" not in after.counters or took <= 0 or before.header.boot != after.header.boot:
            continue
        if link := facts.mission.robots[name].link:
            do = f"is the vehicle on, and does it send to `{link}`? baud rate, cable, SRn_ parameters of the port"
        else:
            link = "the link to its simulator"
            do = "does the process of its simulator run? see `daemons` and the output of `argosy run`"
        came = (after.counters["messages"] - before.counters.get("messages", 0)) / took
        bad = (after.counters.get("bad_checksums", 0) - before.counters.get("bad_checksums", 0)) / took
        if came == 0:
            diagnoses.append(Diagnosis("error", "vehicles", f"{name}: nothing is received on {link}", do))
        elif came < FEW:
            diagnoses.append(Diagnosis("warning", "vehicles", f"{name}: only {came:.1f} messages/s on {link}", do))
        elif bad > NOISE * came:
            text = f"{name}: {bad:.1f} of {came + bad:.0f} packets/s on {link} are damaged"
            diagnoses.append(
                Diagnosis(
                    "warning", "vehicles", text, "baud rate, cable, grounding; for a radio: distance and antennas"
                )
            )
        else:
            diagnoses.append(Diagnosis("ok", "vehicles", f"{name}: {came:.0f} messages/s on {link}"))
    return diagnoses


def failsafes(facts: Facts) -> list[Diagnosis]:
    """Report whose heartbeats the vehicles' own failsafes monitor; undeclared ones in one finding."""
    vehicles = {
        name: facts.mission.robots[name].failsafe.gcs for name, _, now in _bridges(facts) if "messages" in now.counters
    }
    diagnoses = [
        Diagnosis("ok", "failsafe", f"{name}: monitors heartbeats of `{gcs}`")
        for name, gcs in vehicles.items()
        if gcs not in (None, "none")
    ]
    if undeclared := [name for name, gcs in vehicles.items() if gcs is None]:
        text = f"{', '.join(undeclared)}: no failsafe is declared: the vehicle does not return if its bridge dies"
        diagnoses.append(Diagnosis("warning", "failsafe", text, REMEDIES["failsafe_none"]))
    return diagnoses


def percepts(facts: Facts) -> list[Diagnosis]:
    """Report percepts of the running manifests that are missing.

    Only those with a `ttl` are expected: overrides, which have none, events (`buf = "add"`) and optional ones may be
    absent.
    """
    diagnoses: list[Diagnosis] = []
    for robot, found in facts.robots.items():
        if found.problem:
            diagnoses.append(Diagnosis("warning", "percepts", f"{robot}: {found.problem}", "see `daemons`"))
            continue
        live = {
            name
            for name, entry in found.declared.items()
            if entry.get("ttl") is not None and entry.get("buf") != "add" and not entry.get("optional")
        }
        missing = sorted(live - found.percepts.keys())
        if missing:
            where = facts.mission.robots[robot].source
            origins = [
                (str(one.get("driver")), str(one.get("source", "?")))
                for one in map(found.declared.__getitem__, missing)
            ]
            sources = sorted({where(driver, source) for driver, source in origins})
            text = f"{robot}: missing: {', '.join(missing)} (from {', '.join(sources)})"
            advice = [SENDS.get(driver, SENDS[""]) for driver in sorted({driver for driver, _ in origins})]
            do = f"{'; '.join(dict.fromkeys(advice))}; else remove it from the manifest"
            diagnoses.append(Diagnosis("warning", "percepts", text, do))
        else:
            age = _newest(facts, robot, found)
            when = f", the newest {max(0.0, age):.1f} s old" if age is not None else ""
            diagnoses.append(Diagnosis("ok", "percepts", f"{robot}: {count(len(found.percepts), 'percept')}{when}"))
    return diagnoses


def _newest(facts: Facts, robot: str, found: RobotFacts) -> float | None:
    """Return the age of a robot's newest percept in seconds, by the clock of its board."""
    if not found.percepts:
        return None
    link = facts.from_here.get(facts.mission.robots[robot].board)
    ahead = link.ahead if link is not None and link.ahead is not None else 0.0
    return (facts.now - max(found.percepts.values())) / 1e9 + ahead


def _bridges(facts: Facts) -> list[tuple[str, Health, Health]]:
    """Return the robots whose bridge reported its health at both times, with the reports."""

    def health_by_board(rows: list[Row]) -> dict[str, Health]:
        return {row.name: row.now for row in rows if row.daemon == "bridged" and row.well and row.now is not None}

    before, after = health_by_board(list(facts.earlier)), health_by_board(list(facts.rows))
    return [(name, before[name], after[name]) for name in facts.mission.robots if name in before and name in after]
