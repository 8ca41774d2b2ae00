"""``agentd test``: run the test plans of files and folders."""

from __future__ import annotations

import re
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from agentd.extensions.user_code import UserCodeError
from agentd.process import Terminated, allow_deep_calls, seconds
from agentd.runtime.program_paths import read_folders
from agentd.standalone.command import add_environment_arguments, add_path_argument, make_environment
from agentd.testing.discovery import Case, TestPaths, find_cases
from agentd.testing.results import Outcome, Unread, Verdict
from agentd.testing.runner import Settings, run_case
from commd.process.state_dir import write_output
from schemas.humanize import count

DESCRIPTION = """Run the plans marked as tests, @name[test] +!goal <- ..., each in a new agent and on virtual time:
waiting takes no real time. A test checks results by !assert_equals(Expected, Actual[, Tolerance]),
!assert_true(Formula), !assert_false(Formula), !assert_contains(List, Member) and others:
see docs/guides/writing-programs.md. Exit code: 0 if all tests pass, 1 if not, 2 if there is no test or something cannot
be read."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `agentd test`."""
    parser.description = DESCRIPTION
    parser.add_argument(
        "places", nargs="+", metavar="FILE|FOLDER", help="program, or folder with programs (subfolders included)"
    )
    parser.add_argument(
        "--filter",
        metavar="TEXT",
        help="run only tests whose name contains TEXT or matches it as a pattern, such as 'greets_*' (default: all)",
    )
    parser.add_argument("--junit", metavar="FILE.xml", help="also write the results to this file, as JUnit XML")
    parser.add_argument(
        "--timeout",
        type=seconds,
        metavar="S",
        help="end each test after S seconds of real time or of its virtual time (more than 0, at most 1e9; default: "
        "30 s of real time, 3600 s of virtual time)",
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="integer that random numbers of each test start from (default 0)"
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="also show the output of tests that pass")
    add_environment_arguments(parser)
    add_path_argument(parser)


def run(args: Namespace) -> int:
    """Find the tests, run them and report the results. Returns the exit code of the command's description."""
    allow_deep_calls()
    begun = time.monotonic()
    try:
        settings = _settings(args)
    except ValueError as error:
        print(f"agentd test: error: {error}", file=sys.stderr)
        return 2
    outcomes: list[Outcome] = []
    unread: list[Unread] = []
    running: Case | None = None
    broken_off: BaseException | None = None
    try:
        for case in find_cases(args.places, settings.paths, args.filter):
            if isinstance(case, Unread):
                print(case.message, file=sys.stderr)
                unread.append(case)
                continue
            running = case
            outcome = run_case(case, settings)
            running = None
            outcomes.append(outcome)
            _print_outcome(outcome, args.verbose)
    except UserCodeError as error:
        print(f"agentd test: error: {error}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, Terminated) as signalled:  # the results so far are still reported and written
        broken_off = signalled
        if running is not None:
            message = "the run was interrupted while this test ran"
            line = running.plan.position.line
            outcomes.append(Outcome(running.name, running.file, line, Verdict.ERROR, message=message))
            _print_outcome(outcomes[-1], args.verbose)
    for outcome in outcomes:
        if not outcome.passed:
            print("", *details_of(outcome), sep="\n")
    if args.junit is not None and not _write(args.junit, junit(outcomes, unread)):
        return 2
    if not outcomes and not unread:
        wanted = f" whose name fits {args.filter}" if args.filter is not None else ""
        print(f"agentd test: error: there is no test{wanted} in {' '.join(args.places)}", file=sys.stderr)
        return 2
    print("", summary(outcomes, unread, time.monotonic() - begun), sep="\n")
    if broken_off is not None:
        raise broken_off
    return 2 if unread else 0 if all(outcome.passed for outcome in outcomes) else 1


def _print_outcome(outcome: Outcome, verbose: bool) -> None:
    print(line_of(outcome), flush=True)
    if verbose and outcome.passed:
        print("".join(f"        {line}\n" for line in outcome.output), end="")


def _settings(args: Namespace) -> Settings:
    settings = Settings(
        read_folders(args.include_path, TestPaths),
        seed=args.seed,
        environment=lambda: make_environment(args.env),
        environment_arguments=tuple(args.env_arg),
    )
    if args.timeout is None:
        return settings
    return replace(settings, own_seconds=args.timeout, real_seconds=args.timeout)


def _write(file: str, document: bytes) -> bool:
    try:
        write_output(Path(file), document)
    except OSError as error:
        print(f"agentd test: error: cannot write {file}: {error.strerror or error}", file=sys.stderr)
        return False
    return True


MOST_OUTPUT = 30
"""Lines of a failed test's output that are shown; the XML has all that were kept."""

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold."""


def line_of(outcome: Outcome) -> str:
    """One line per test plan."""
    where = f"{outcome.file}:{outcome.line}"
    if outcome.empty:
        return f"ok      {where} {outcome.name}  (warning: passed without an assertion)"
    if outcome.passed:
        return f"ok      {where} {outcome.name}"
    return f"{outcome.verdict.value:<7} {where} {outcome.name}: {outcome.message}"


def details_of(outcome: Outcome) -> Iterator[str]:
    """Return the details of a test plan that did not pass."""
    yield f"{outcome.verdict.value} {outcome.file}:{outcome.line}: {outcome.name}"
    yield f"    {outcome.message}"
    if outcome.place:
        yield f"    at {outcome.place}: {outcome.excerpt}".rstrip()
    if outcome.formula:
        yield f"    that is: {outcome.formula}"
    for goal in outcome.goals:
        yield f"    for {goal}"
    yield from (f"    {line}" for line in outcome.unapplied[:MOST_OUTPUT])
    if outcome.output:
        yield "    its output:"
        for line in outcome.output[:MOST_OUTPUT]:
            yield from (f"        {part}" for part in line.split("\n"))
        if len(outcome.output) > MOST_OUTPUT:
            yield f"        ... and {len(outcome.output) - MOST_OUTPUT} more lines"


def summary(outcomes: Sequence[Outcome], unread: Sequence[Unread], seconds: float) -> str:
    """Return the counts in one line; `seconds` is the real time that the tests took."""
    counts = {verdict: sum(o.verdict is verdict for o in outcomes) for verdict in Verdict}
    parts = [f"{counts[Verdict.PASSED]} passed"]
    for verdict, word in ((Verdict.FAILED, "failed"), (Verdict.ERROR, "in error"), (Verdict.TIMED_OUT, "timed out")):
        if counts[verdict]:
            parts.append(f"{counts[verdict]} {word}")
    empty = sum(o.empty for o in outcomes)
    if empty:
        parts.append(f"{empty} without an assertion")
    if unread:
        parts.append(f"{len(unread)} unreadable")
    return f"{count(len(outcomes), 'test')}: {', '.join(parts)} ({seconds:.1f} s)"


def junit(outcomes: Sequence[Outcome], unread: Sequence[Unread]) -> bytes:
    """Return a JUnit XML document: one test suite per file, one test case per test plan."""
    root = ElementTree.Element("testsuites", name="agentd test")
    files: dict[str, list[Outcome | Unread]] = {}
    members_of_all: list[Outcome | Unread] = [*outcomes, *unread]
    for each in members_of_all:
        files.setdefault(each.file, []).append(each)
    for file, members in files.items():
        suite = ElementTree.SubElement(root, "testsuite", name=file)
        for member in members:
            _testcase(suite, file, member)
        _count(suite, [m for m in members if isinstance(m, Outcome)], sum(isinstance(m, Unread) for m in members))
    _count(root, outcomes, len(unread))
    ElementTree.indent(root)
    document: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"


def _count(element: ElementTree.Element, outcomes: Sequence[Outcome], unread: int) -> None:
    failures = sum(o.verdict in (Verdict.FAILED, Verdict.TIMED_OUT) for o in outcomes)
    errors = sum(o.verdict is Verdict.ERROR for o in outcomes) + unread
    element.set("tests", str(len(outcomes) + unread))
    element.set("failures", str(failures))
    element.set("errors", str(errors))
    if element.tag == "testsuite":
        element.set("skipped", "0")
    element.set("time", f"{sum(o.seconds for o in outcomes):.3f}")


def _testcase(suite: ElementTree.Element, file: str, member: Outcome | Unread) -> None:
    of_class = Path(file).with_suffix("").as_posix().strip("/").replace("/", ".")
    if isinstance(member, Unread):
        case = ElementTree.SubElement(suite, "testcase", name="(read)", classname=of_class, time="0.000")
        error = ElementTree.SubElement(case, "error", message="the file cannot be used", type="unreadable")
        error.text = _clean(member.message)
        return
    attributes = {"name": _clean(member.name), "classname": of_class, "time": f"{member.seconds:.3f}"}
    case = ElementTree.SubElement(suite, "testcase", attributes, file=member.file, line=str(member.line))
    if not member.passed:
        kind = "error" if member.verdict is Verdict.ERROR else "failure"
        types = {Verdict.FAILED: "assertion", Verdict.TIMED_OUT: "timeout", Verdict.ERROR: "error"}
        problem = ElementTree.SubElement(case, kind, message=_clean(member.message), type=types[member.verdict])
        problem.text = _clean("\n".join(details_of(member)))
    if member.output:
        ElementTree.SubElement(case, "system-out").text = _clean("\n".join(member.output))


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
