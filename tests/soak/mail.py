"""Mail between three boards for real: what is lost, what comes twice and in which order, while all of it breaks.

`make soak` runs 100,000 messages with links cut, daemons killed and a disk full, and writes its part of
docs/measurements/soak.md; a part of that, some thousand messages, is a test (tests/boards/test_mail.py). Needs root
and iproute2.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from tests.boards.disk import Disk
from tests.boards.fleet import Fleet, Look
from tests.boards.network import Network, NoNamespaces, possible
from tests.boards.numbered_mail import Post, Verdict, judge
from tests.boards.troubles import Course, Trouble, plan
from tests.soak.report import write_section

BOARDS = ("pi1", "pi2", "pi3")
AGENTS = {"ann": "pi1", "bob": "pi2", "cid": "pi3", "dan": "pi1", "eve": "pi2", "fay": "pi3"}
"""With their boards: each has a neighbour in its own `agentd`."""
MESSAGES = 100_000
KILLS = 30
CUTS = (5.0, 60.0, 5.0, 5.0, 60.0, 5.0)
FULL = ("pi3", 20.0)
"""The board whose disk is full, and for how many seconds."""
DISK = 64
"""MB of that board's disk."""
RATE = 120.0
"""Messages a second of all agents together, as they wait between two; the minds take their time besides."""
SETTLING = 5.0
"""Seconds after the last message in which nothing more may come."""


@dataclass
class Outcome:
    """What a run has shown."""

    verdict: Verdict
    seconds: float
    """From the first message to the last."""
    happened: dict[str, int] = field(default_factory=dict)
    ended_by_themselves: list[str] = field(default_factory=list)
    waiting: int = 0
    """Messages that still waited at the end."""
    dead: int = 0
    """Dead letters at the end."""
    complaints: list[str] = field(default_factory=list)
    """Tracebacks and defects that a daemon has told."""


def run(
    folder: Path, post: Post, troubles: Sequence[Trouble], patience: float, say: Callable[[str], None] = print
) -> Outcome:
    """Let the agents write to one another in troubled times, and judge when all is quiet or patience is over."""
    with ExitStack() as stack:
        network = stack.enter_context(Network(BOARDS))
        full = {trouble.board for trouble in troubles if trouble.what == "full disk"}
        disks = {board: stack.enter_context(Disk(folder / "state" / board, DISK)) for board in sorted(full)}
        fleet = stack.enter_context(Fleet(network, _written(folder, post, network), folder / "state"))
        fleet.up()
        first = {name: fleet.look(board) for name, board in post.agents.items()}
        for name, look in first.items():  # beyond the initial goal, which no restart posts again
            look.until(partial(_begun, post, name), f"{name} sends", 60)
        course = Course(fleet, troubles, disks, say)
        reported = time.monotonic()
        minds: dict[str, list[str]] = {}
        while course.seconds < patience:
            course.step()
            if course.over:
                minds = {name: look.mind(name) or [] for name, look in first.items()}
                if all(minds.values()) and _all_taken(post, minds):
                    break
                if time.monotonic() > reported + 20:
                    reported = time.monotonic()
                    say(f"{course.seconds:.0f} s: {judge(post, minds) if all(minds.values()) else 'an agent is away'}")
            time.sleep(0.5 if course.over else 0.1)
        seconds = course.seconds
        time.sleep(SETTLING)
        for name, look in first.items():
            look.until(partial(Look.mind, agent=name), f"{name} answers", 60)
            minds[name] = look.mind(name) or []
        boxes = next(iter(first.values())).boxes()
        return Outcome(
            judge(post, minds),
            seconds,
            dict(course.happened),
            course.ended_by_themselves,
            sum(queue["messages"] for box in boxes.values() for queue in box.get("queues", ())),
            sum(box.get("dead_count", 0) for box in boxes.values()),
            _complaints(fleet),
        )


def _written(folder: Path, post: Post, network: Network) -> Path:
    entries = ", ".join(f"{name}: {{address: {address}}}" for name, address in network.addresses.items())
    for name, text in post.programs().items():
        (folder / f"{name}.asl").write_text(text)
    path = folder / "letters.yaml"
    path.write_text(post.mission().replace("BOARDS", f"{{{entries}}}"))
    return path


def _begun(post: Post, name: str, look: Look) -> bool:
    return _progress(look.mind(name), post, name) > 3


def _progress(beliefs: list[str] | None, post: Post, name: str) -> int:
    """How many messages an agent has sent to the one to whom it has sent least."""
    if not beliefs:
        return 0
    reported = [belief.replace(" ", "") for belief in beliefs]
    counts = []
    for sender, receiver in post.pairs:
        if sender == name:
            found = [belief for belief in reported if belief.startswith(f"next({receiver},")]
            counts.append(int(found[0].split(",")[1].split(")")[0]) - 1 if found else 0)
    return min(counts)


def _all_taken(post: Post, minds: dict[str, list[str]]) -> bool:
    sent = all(_progress(minds[name], post, name) >= post.each for name in post.agents)
    return sent and judge(post, minds).lost == 0


def _complaints(fleet: Fleet) -> list[str]:
    found = []
    for board, kind in fleet.running:
        for line in fleet.text(board, kind).splitlines():
            if "Traceback" in line or "defect" in line or "panicked" in line or "undelivered" in line:
                found.append(f"{kind} of {board}: {line}")
    return found


def control(say: Callable[[str], None] = print) -> tuple[Post, Outcome]:
    """Run the same with memories switched off (`on_restart: fresh`) and one kill: the judge has to find fault."""
    post = Post(AGENTS, 12, 500.0, "fresh")
    with tempfile.TemporaryDirectory() as folder:
        return post, run(Path(folder), post, [Trouble(2, "kill agentd", BOARDS[0], 0.5)], 25, say)


def report_control(outcome: Outcome) -> list[str]:
    """Return the section that says what the judge finds where there is something to find."""
    verdict = outcome.verdict
    return [
        "The same agents, programs and judge with `on_restart: fresh`, and one agentd killed once: "
        f"{verdict.taken} messages taken, **{verdict.lost} lost, {verdict.duplicated} duplicated, "
        f"{verdict.disordered} out of order**. A judge that found nothing here would find nothing above."
    ]


def report(post: Post, outcome: Outcome, seed: int) -> list[str]:
    """Return the section of the report."""
    verdict = outcome.verdict
    kills = {what: count for what, count in sorted(outcome.happened.items()) if what.startswith("kill")}
    lines = [
        f"**{verdict.sent:,} messages** among {len(post.agents)} agents on {len(BOARDS)} boards (network namespaces, a "
        f"router each): **{verdict.lost} lost, {verdict.duplicated} duplicated, {verdict.disordered} out of order**, "
        "by the final beliefs of all agents.",
        "",
        f"Meanwhile, by seed {seed}: {sum(kills.values())} kills -9 at random "
        f"({', '.join(f'{count} of {what[5:]}' for what, count in kills.items())}); cuts of "
        f"{', '.join(f'{cut:g} s' for cut in CUTS)} (silent, announced, between two boards in turns); "
        f"{FULL[1]:g} s without a byte free on the disk of {FULL[0]}. "
        f"Daemons that ended by themselves: {len(outcome.ended_by_themselves)}. It took {outcome.seconds:.0f} s, "
        f"{verdict.sent / outcome.seconds:.0f} messages/s; at the end {outcome.waiting} messages waited, and "
        f"{outcome.dead} were dead letters.",
    ]
    return lines + (["", *(f"* {line}" for line in outcome.ended_by_themselves)] if outcome.ended_by_themselves else [])


def main() -> int:
    """Run, print and write the report. Returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--messages", type=int, default=MESSAGES)
    parser.add_argument("--rate", type=float, default=RATE)
    parser.add_argument("--kills", type=int, default=KILLS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--dry", action="store_true", help="do not write docs/measurements/soak.md")
    args = parser.parse_args()
    try:
        possible()
    except NoNamespaces as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    pairs = len(AGENTS) * (len(AGENTS) - 1)
    post = Post(AGENTS, -(-args.messages // pairs), 1000 * pairs / args.rate)
    lasts = post.total / args.rate
    troubles = plan(BOARDS, 0.95 * lasts, args.kills, CUTS, FULL, args.seed)
    with tempfile.TemporaryDirectory() as folder:
        outcome = run(Path(folder), post, troubles, 2 * lasts + 300, lambda line: print(line, flush=True))
    print(outcome.verdict, *outcome.verdict.details, *outcome.complaints[:20], sep="\n")
    print(f"{outcome.seconds:.0f} s, {outcome.waiting} waiting, {outcome.dead} dead letters, {outcome.happened}")
    _, without = control(lambda line: print(line, flush=True))
    print(f"without memory: {without.verdict}")
    if not args.dry:
        write_section("Mail", report(post, outcome, args.seed))
        write_section("Mail without memory", report_control(without))
    if without.verdict.clean:
        return 1
    return 0 if outcome.verdict.clean and outcome.verdict.sent == post.total and not outcome.waiting else 1


if __name__ == "__main__":
    sys.exit(main())
