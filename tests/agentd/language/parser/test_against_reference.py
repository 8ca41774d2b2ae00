"""Compiled queries answer as a reference does that was written from the book, wherever a query can stand."""

import re
from collections.abc import Callable, Iterator
from random import Random
from typing import TypeVar

from agentd.language.parse import parse_program
from agentd.language.syntax_tree.nodes import Rule
from tests.agentd.generated_queries import Call, Case, Generator
from tests.agentd.minds import run
from tests.agentd.reference import Reference, Undetermined
from tests.support.amount import some_of

MANY = some_of(200, 2)
"""Cases that the reference can judge; all are made from their numbers, so a failure is there again in the next run."""
Made = TypeVar("Made")


def generators() -> Iterator[Generator]:
    """Yield generators without end, each with choices of its own."""
    number = 0
    while True:
        yield Generator(Random(number).choice)
        number += 1


def judged(make: Callable[[Generator], Made], check: Callable[[Made], bool]) -> int:
    """Check cases until `MANY` were judged. Returns of how many the reference could not say."""
    left, undetermined = MANY, 0
    for generator in generators():
        if check(make(generator)):
            left -= 1
        else:
            undetermined += 1
        if not left:
            break
    return undetermined


def expected(case: Case) -> list[str]:
    """The answers of the reference."""
    asked = f"asked({case.shown}) :- {case.known} & {case.query}."
    program = parse_program(f"{case.program}\n{asked}", "reference.asl")
    rule = program.items[-1]
    assert isinstance(rule, Rule)
    return Reference(program.items[:-1]).answers(rule.body, rule.head.args[0])


def program_of(case: Case) -> str:
    """The query wherever it can stand; each place prints lines that begin with its name."""
    known, query, shown = case.known, case.query, case.shown
    both = f"{known} & {query}"
    steps = "; ".join(part for part in known.split(" & ") if part != "true")
    return f"""{case.program}
the({shown}) :- {both}.
an(X,Y,Z,W) :- {query}.
none :- not ({both}).
!go.
+!go <- !all; !steps; !held; !each; !branch; !no; !context; !test; !tested; !rule; !arguments; !passed.
+!all <- .findall({shown}, {both}, L); .print("findall ", L).
+!steps <- {steps}{"; " if steps else ""}.findall({shown}, {query}, L); .print("steps ", L).
-!steps <- .print("steps []").
+!held <- .findall({shown}, {known} & Held = ({query}) & Held, L); .print("held ", L).
+!each <- for ({both}) {{ .print("for ", {shown}) }}.
+!branch <- if ({both}) {{ .print("if ", {shown}) }}
  else {{ .print("if none") }}.
+!no : none <- .print("not none").
+!no : not none & not not_there <- .print("not some").
+!context : {both} <- .print("context ", {shown}).
+!context <- .print("context none").
+!test <- ?({both}); .print("test ", {shown}).
-!test <- .print("test none").
+!tested <- {steps}{"; " if steps else ""}?({query} & true); .print("tested ", {shown}).
-!tested <- .print("tested none").
+!rule <- .findall(O, the(O), L); .print("rule ", L).
+!arguments <- .findall({shown}, {known} & an(X,Y,Z,W), L); .print("arguments ", L).
+!passed <- {steps}{"; " if steps else ""}!pass(X,Y,Z,W).
-!passed.
+!pass(X,Y,Z,W) : {query} <- .print("passed ", {shown}).
+!pass(X,Y,Z,W) <- .print("passed none").
"""


def wanted(case: Case, answers: list[str]) -> list[str]:
    """What the program prints if each place has the answers of the reference."""
    whole = f"[{','.join(answers)}]"
    first = answers[0] if answers else "none"
    lines = [f"findall {whole}", f"steps {whole}", f"held {whole}", *(f"for {answer}" for answer in answers)]
    lines += [f"if {first}", f"not {'some' if answers else 'none'}"]
    lines += [f"context {first}", f"test {first}", f"tested {first}", f"rule {whole}", f"arguments {whole}"]
    return [*lines, f"passed {first}"]


def anonymous(line: str) -> str:
    """A printed line with ``_`` for each free variable."""
    return re.sub(r"\b[A-Z_]\w*", "_", line)


def check(case: Case) -> bool:
    """Compare; False if the reference cannot say."""
    try:
        answers = expected(case)
    except (Undetermined, RecursionError):
        return False
    if sum(map(len, answers)) > 20_000:
        return False
    prints = [anonymous(line) for line in run(program_of(case)).prints]
    found = [line for line in prints if line != "passed none" or not answers]
    assert found == wanted(case, answers), program_of(case)
    return True


def test_a_query_has_the_answers_of_the_reference_wherever_it_stands() -> None:
    assert judged(Generator.case, check) < MANY


def check_call(case: Call) -> bool:
    """Compare what a goal and a test goal bind with the first answer of rules that say the same as their plans."""
    known, call, shown = case.known, case.call, case.shown
    rules = "\n".join(f"{head} :- {context}." for head, context in case.plans)
    query = f"asked({shown}) :- {known} & {call}."
    program = parse_program(f"{case.program}\n{rules}\n{query}", "reference.asl")
    rule = program.items[-1]
    assert isinstance(rule, Rule)
    try:
        answers = Reference(program.items[:-1]).answers(rule.body, rule.head.args[0])
    except (Undetermined, RecursionError):
        return False
    steps = "".join(f"{part}; " for part in known.split(" & ") if part != "true")
    plans = "\n".join(f"+!{head} : {context}. +?{head} : {context}." for head, context in case.plans)
    source = f"""{case.program}
{plans}
!go.
+!go <- !achieved; !tested.
+!achieved <- {steps}!{call}; .print({shown}).
-!achieved <- .print(none).
+!tested <- {steps}?{call}; .print({shown}).
-!tested <- .print(none).
"""
    assert [anonymous(line) for line in run(source).prints] == [answers[0] if answers else "none"] * 2, source
    return True


def test_a_goal_binds_what_the_first_of_its_plans_says_as_the_reference_does() -> None:
    assert judged(Generator.call, check_call) < MANY
