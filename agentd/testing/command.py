"""``agentd test``: run the test plans of files and folders."""

from __future__ import annotations

import sys
import time
from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path

from agentd.exit_handling import Terminated, seconds
from agentd.extensions.user_code import UserCodeError
from agentd.runtime.program_paths import read_folders
from agentd.standalone.command import DEEPEST_CALLS, add_environment_arguments, add_path_argument, make_environment
from agentd.testing.discovery import Case, TestPaths, find_cases
from agentd.testing.report import details_of, junit, line_of, summary
from agentd.testing.results import Outcome, Unread, Verdict
from agentd.testing.runner import Settings, run_case

DESCRIPTION = """Run the plans marked as tests, @name[test] +!goal <- ..., each in a fresh agent and on virtual time.
They say what they expect by !assert_equals(Expected, Actual[, Tolerance]), !assert_true(Formula),
!assert_false(Formula), !assert_contains(List, Member) and others: see docs/guides/writing-programs.md.
Exit code: 0 if all have passed, 1 if not, 2 if there is nothing to run or something cannot be read."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `agentd test`."""
    parser.description = DESCRIPTION
    parser.add_argument("places", nargs="+", metavar="FILE|FOLDER", help="a program, or a folder with programs")
    parser.add_argument("--filter", metavar="TEXT", help="only tests whose name contains this, or fits this pattern")
    parser.add_argument("--junit", metavar="FILE.xml", help="also write the results as JUnit XML")
    parser.add_argument(
        "--timeout",
        type=seconds,
        metavar="S",
        help="a test fails after so many seconds, real ones or of its own time, in which waiting costs nothing "
        "(default: 30 real ones, an hour of its own)",
    )
    parser.add_argument("--seed", type=int, default=0, help="start of the random numbers of each test (default 0)")
    parser.add_argument("-v", "--verbose", action="store_true", help="show the output of tests that have passed too")
    add_environment_arguments(parser)
    add_path_argument(parser)


def run(args: Namespace) -> int:
    """Find the tests, run them, tell what came of them."""
    sys.setrecursionlimit(max(sys.getrecursionlimit(), DEEPEST_CALLS))
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
            _tell(outcome, args.verbose)
    except UserCodeError as error:
        print(f"agentd test: error: {error}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, Terminated) as signalled:  # what is known by now is told and written all the same
        broken_off = signalled
        if running is not None:
            message = "the run was broken off while this test ran"
            line = running.plan.position.line
            outcomes.append(Outcome(running.name, running.file, line, Verdict.ERROR, message=message))
            _tell(outcomes[-1], args.verbose)
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


def _tell(outcome: Outcome, verbose: bool) -> None:
    print(line_of(outcome), flush=True)
    if verbose and outcome.passed:
        print("".join(f"        {line}\n" for line in outcome.output), end="")


def _settings(args: Namespace) -> Settings:
    settings = Settings(
        TestPaths.of(read_folders(args.include_path)),
        seed=args.seed,
        environment=lambda: make_environment(args.env),
        environment_arguments=tuple(args.env_arg),
    )
    if args.timeout is None:
        return settings
    return replace(settings, own_seconds=args.timeout, real_seconds=args.timeout)


def _write(file: str, document: bytes) -> bool:
    try:
        Path(file).write_bytes(document)
    except OSError as error:
        print(f"agentd test: error: cannot write {file}: {error.strerror or error}", file=sys.stderr)
        return False
    return True
