"""What ``.save_agent`` writes, and what crosses the bus as source text, reads back as the same."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from agentd.conversion.term_conversion import from_wire, to_wire
from agentd.language.syntax_tree.printer import source_text
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Collection, Literal, Var, atom
from agentd.language.terms.to_ast import NoSyntax, ToSyntax
from agentd.mind.data.effects import Log
from agentd.stdlib.team import program_text
from tests.agentd.generated_programs import terms
from tests.agentd.minds import World, mind_of, term
from tests.support.amount import some_of

SLOW_TO_MAKE = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)


def written(value: object) -> str:
    return source_text(ToSyntax(100).term(value))


@settings(max_examples=some_of(200), deadline=None, suppress_health_check=SLOW_TO_MAKE)
@given(terms.map(source_text))
def test_a_term_written_as_syntax_reads_back_as_a_term_written_alike(text: str) -> None:
    try:
        once = written(term(text))
    except NoSyntax:
        return
    assert written(term(once)) == once


@settings(max_examples=some_of(300), deadline=None)
@given(st.text(alphabet="ab\"\\\nt'{}[]#", max_size=8))
def test_a_string_reads_back_as_itself_or_is_refused(text: str) -> None:
    try:
        assert term(written(text)) == text
    except NoSyntax:
        assert "\\" in text


@pytest.mark.parametrize("number", [0.0, -3.0, 0.1, 1e20, 1e300, -1e-7, float("inf"), -float("inf"), 5e-324])
def test_a_number_reads_back_as_itself(number: float) -> None:
    assert term(written(number)) == number


def test_a_number_that_is_none_reads_back_as_none() -> None:
    read = term(written(float("nan")))
    assert read != read


def test_different_variables_of_one_name_stay_different() -> None:
    first, second = Var("X"), Var("X")
    assert written(Literal(signature("p", 3), (first, second, first))) == "p(X,X_1,X)"
    sent = from_wire(to_wire(Literal(signature("p", 3), (first, second, first))))
    assert sent.args[0] is sent.args[2]
    assert sent.args[0] is not sent.args[1]


def test_the_same_variable_is_one_inside_and_outside_of_a_formula_that_is_sent() -> None:
    sent = from_wire(to_wire(term("p(X,(q(X) & r(Y)),Y)")))
    formula = sent.args[1]
    assert formula.operands[0].args[0] is sent.args[0]
    assert formula.operands[1].args[0] is sent.args[2]


@pytest.mark.parametrize(
    ("value", "why"),
    [
        (atom("not a name"), "cannot be written"),
        (atom("not"), "cannot be written"),
        ("ends with \\", "backslash"),
        (Collection("map", {}), "cannot be written"),
        (term("f(" * 101 + "a" + ")" * 101), "nested deeper"),
    ],
)
def test_what_cannot_be_written_is_refused_with_the_reason(value: object, why: str) -> None:
    with pytest.raises(NoSyntax, match=why):
        written(value)


SOURCE = r"""
p("say \"hi\"", 'Quoted', -3, [a,"b\n"|_T])[note("q\"")].
lab::q(X, _, X).
~r(1).
s(X) :- p(_,_,X,_) & not (X > "a\"") | lab::q(X,1,2).
@named[k("v\"")] +!g(N) : N > 1 <- if (N > 2) { .print("\"") } elif (N == 7) { -+q(N) } else { !!h };
   { a } |&| { b; c }.
@gc +!h <: s(1) <- .wait(5). {
+!inner <- .print(inner).
}
-!g(_)[error(E)] <- while (s(E)) { ?s(E) }; for (s(Y)) { +t(Y) }; V = { +!z <- .print("\"") }; .add_plan(V).
+lab::q(_,_,_) <- -+w(2**3).
^!g(_)[state(S)] <- .print(S).
"""


def test_a_saved_program_reads_back_as_the_same_program() -> None:
    mind = mind_of(SOURCE)
    once = program_text(mind, [term('begin("x\\"y")')])
    again = mind_of(once)
    beginning = '!begin("x\\"y").\n'
    assert beginning in once
    assert sorted(program_text(again, []).splitlines()) == sorted(once.replace(beginning, "").splitlines())
    assert sorted(map(str, again.beliefs.facts())) == sorted(map(str, mind.beliefs.facts()))


def test_what_cannot_be_saved_is_left_out_and_reported() -> None:
    world = World(mind_of('!go. +!go <- .map.create(M); +m(M); .term2string(T, "no term"); +t(T); +fine(1).')).settle()
    text = program_text(world.mind, [])
    assert "fine(1)" in text
    assert "m(" not in text.split("@")[0].replace("term", "")
    told = [e.text for e in world.mind.effects if isinstance(e, Log)]
    assert len(told) == 2
    assert all(line.startswith(".save_agent leaves out") for line in told)
