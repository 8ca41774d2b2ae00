"""Telling what came of tests: lines for people, and JUnit XML for machines."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

from agentd.testing.results import Outcome, Unread, Verdict
from schemas.humanize import count

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
    """What helps to find out why a test plan did not pass."""
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
    """The counts, in one line."""
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
    """A JUnit XML document: one test suite per file, one test case per test plan."""
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
