"""Ground facts of large programs: recognised without a syntax tree, and the same as the parser makes of them."""

import random
from pathlib import Path
from typing import Any

import pytest

from agentd.check.programs import Includes
from agentd.check.survey import survey
from agentd.language import parse
from agentd.language.compiler.compile import compile_program
from agentd.language.parser import fact_runs
from agentd.language.parser.fact_runs import MANY, GroundFact
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import Belief, Directive, Position, Program, fields_of
from agentd.language.syntax_tree.source import Source
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.terms import List, Literal
from agentd.mind.mind import Mind
from tests.agentd.check.findings import findings_about
from tests.agentd.generated_programs import corpus
from tests.agentd.mutants import characters, tokens
from tests.support.amount import some_of

INPUTS = some_of(400)

DATA = """
pos(17, 3.5, "text", [a,b]). pos(-1,.5,"",[]). // a comment
/* one */ ~blocked('Big Door', [[1,2],[f(x,1)]]).
on. on[source(tower), since(3)]. flag(true,false)[ ].
text("a \\"b\\" \\n \\\\ c \\t", 'it is', 1e3, 2.5E-2).
deep(f(g(h(1)))). deeper(f(g(h(i(1))))). lists([[[[[1]]]]]).
"""

BESIDE = """
p(X). p(1+2). p(-X). p(- 1). p(--1). p(3 - 5). ns::p(1). ::p(1). p(ns::q). p(a.b). p(math.pi). p(.t). p (1).
p([a|T]). p(1)[a|T]. p({ +!g }). p(/* c */ 1). p(not a). p(1 < 2). p(true & false). p(if2). iffy(1). p(~q).
"""

WRONG = (
    "p(1",
    "p(1]).",
    "p([1).",
    "p(1,).",
    "p(,1).",
    "p().",
    "if(1).",
    "p(true(1)).",
    'p("a).',
    "p(1) q(2).",
    "p(1).q(2).",
    "p(1).Q(2).",
    "a.B.",
    "p(1)..",
    "p(1);",
    "p([1 2]).",
    "p('a).",
    "p(1)[2",
    "~~p(1).",
    "p(not).",
    'p("\\x").',
    "p(1).5.",
)


def _tree(node: Any) -> Any:
    """A syntax tree with all positions and no class but those of the syntax."""
    if isinstance(node, tuple):
        return tuple(map(_tree, node))
    names = fields_of(type(node))
    if not names:
        return node
    kind = Belief if isinstance(node, GroundFact) else type(node)
    return (kind.__name__, *(_tree(getattr(node, name)) for name in names))


def _read(text: str, recognise_facts: bool) -> Any:
    """A program, or what is wrong with it."""
    try:
        return parse._whole(Source(text, "a.asl"), recognise_facts)
    except SyntaxErrors as errors:
        return errors.problems


def _assert_alike(text: str) -> int:
    """Compare what both ways make of a text; the number of facts that were recognised."""
    plain, quick = _read(text, False), _read(text, True)
    if not isinstance(plain, Program):
        assert not isinstance(quick, Program)
        assert _problems(text) == plain
        return 0
    assert isinstance(quick, Program)
    recognised = [item for item in _items(quick) if isinstance(item, GroundFact)]
    terms = [fact.term() for fact in recognised]
    assert (_tree(quick.items), quick.warnings, quick.scoped) == (_tree(plain.items), plain.warnings, plain.scoped)
    assert quick.items == plain.items
    for fact, term in zip(recognised, terms, strict=True):
        assert _written(term) == _written(instantiate(fact.literal))
    return len(recognised)


def _problems(text: str) -> Any:
    """What the parser says of a text with many facts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parse, "has_many_facts", lambda text: True)
        with pytest.raises(SyntaxErrors) as caught:
            parse.parse_program(text, "a.asl")
    return caught.value.problems


def _items(program: Program) -> list[Any]:
    found: list[Any] = []
    pending = list(program.items)
    while pending:
        item = pending.pop()
        found.append(item)
        pending += (item.items or ()) if isinstance(item, Directive) else ()
    return found


def _written(term: Any) -> Any:
    """A ground term to the last bit: kinds, signatures, annotations, the signs of zeros."""
    if type(term) is Literal:
        return term.sig, tuple(map(_written, term.args)), tuple(map(_written, term.annots))
    if type(term) is List:
        return "list", tuple(map(_written, term.items[term.at :])), term.tail is None or _written(term.tail)
    return type(term), repr(term)


def test_facts_are_recognised_and_mean_what_the_parser_makes_of_them() -> None:
    assert _assert_alike(DATA) == 8
    assert _assert_alike(BESIDE) == 2, "p(if2) and iffy(1): what computes, binds or is scoped is left to the parser"


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_among_facts_is_reported_as_elsewhere(wrong: str) -> None:
    _assert_alike(f"{DATA}{wrong}\n{DATA}")
    _assert_alike(wrong)


@pytest.mark.parametrize("make", [characters, tokens])
def test_programs_and_their_mutants_are_read_alike_both_ways(make: Any) -> None:
    recognised = 0
    for number in range(INPUTS):
        rng = random.Random(f"facts/{number}")
        recognised += _assert_alike(f"{make(rng)}\n{rng.choice(DATA.splitlines())}")
    assert recognised > INPUTS / 20


def test_the_programs_of_the_corpus_are_read_alike_both_ways() -> None:
    assert sum(map(_assert_alike, corpus())) > 50


def test_facts_with_a_character_changed_are_read_alike_both_ways() -> None:
    rng = random.Random("facts")
    for _ in range(INPUTS):
        text = rng.choice((DATA, BESIDE))
        for _ in range(rng.randint(1, 3)):
            at = rng.randrange(len(text))
            put = rng.choice((*"()[],.-\"'~/* \n1eaX_{}|:\\", "not ", "true", "::", "//", "/*", ""))
            text = text[:at] + put + text[at + rng.randint(0, 2) :]
        _assert_alike(text)


def _large(count: int = 3000) -> str:
    return "".join(f'pos({n}, {n / 2}, "text {n}", [a,b]).\n' for n in range(count))


def test_a_mind_and_a_check_read_facts_without_parsing_each(monkeypatch: pytest.MonkeyPatch) -> None:
    text = f"{_large()}!s.\n+!s : pos(2999, X, T, [_|R]) <- .print(X, T, R).\n"
    program = parse.parse_program(text, "a.asl")
    parsed = []
    parse_run = fact_runs.FactRun.parse
    monkeypatch.setattr(fact_runs.FactRun, "parse", lambda run: (parsed.append(run), parse_run(run)))
    mind = Mind("a", compile_program(program))
    assert len([*mind.beliefs.facts()]) == 3000
    assert not parsed
    assert findings_about(program) == []
    assert len(parsed) == 1, "one run of them, for the first fact of the predicate"


def test_a_fact_that_names_a_registered_function_is_computed() -> None:
    register = '{ register_function("twice", 1, "twice") }\n'
    text = f"{register}p(1).\np(twice(4)).\n{_large(1000)}twice(X, Y) :- Y = X * 2.\n"
    mind = Mind("a", compile_program(parse.parse_program(text, "a.asl")))
    assert [fact.args for fact in mind.beliefs.facts() if fact.functor == "p"] == [(1.0,), (8.0,)]


def test_facts_in_a_namespace_belong_to_it() -> None:
    text = "{ begin namespace(n) }\n" + _large(1000) + "{ end }\n"
    mind = Mind("a", compile_program(parse.parse_program(text, "a.asl")))
    assert {fact.sig.namespace for fact in mind.beliefs.facts()} == {"n"}


def test_a_fact_equals_the_belief_that_says_the_same_elsewhere() -> None:
    fact = parse.parse_program(_large(1000), "a.asl").items[7]
    assert type(fact) is GroundFact
    other = Belief(fact.literal, Position("b.asl", 1, 1))
    assert (other, hash(other)) == (fact, hash(fact))


def test_a_directive_among_large_facts_is_reported_each_time(tmp_path: Path) -> None:
    program = parse.parse_program(_large(1000) + 'include("a.asl").\ninclude("b.asl").\n', "a.asl")
    assert [one.line for one in findings_about(program)] == [1001, 1002]
    assert len(survey(program.items, Includes("a.asl", None, [])).beliefs) == 3  # type: ignore[arg-type]


@pytest.mark.parametrize("between", ["\n", " ", "\n// a comment\n", "\n/* a comment */\n"])
def test_facts_are_recognised_from_some_number_on_whatever_stands_between_them(between: str) -> None:
    def recognised(count: int) -> int:
        program = parse.parse_program(between.join(f"p({n})." for n in range(count)), "a.asl")
        return sum(isinstance(item, GroundFact) for item in program.items)

    assert recognised(MANY) == 0
    assert recognised(MANY + 1) == MANY + 1


def test_a_few_large_facts_are_recognised_too() -> None:
    program = parse.parse_program("\n".join(f"p({n}, {list(range(5000))})." for n in range(10)), "a.asl")
    assert sum(isinstance(item, GroundFact) for item in program.items) == 10
