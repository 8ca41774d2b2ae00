"""AgentSpeak text becomes the syntax tree that `agentd.language.syntax_tree.nodes` describes."""

import json
import time
from pathlib import Path

import pytest

from agentd.language.parse import (
    parse_file,
    parse_formula,
    parse_literal,
    parse_plan,
    parse_program,
    parse_term,
    parse_trigger,
)
from agentd.language.parser import parse_tables
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import (
    And,
    Arithmetic,
    Belief,
    Body,
    BodyTerm,
    Directive,
    For,
    Fork,
    Goal,
    If,
    InternalAction,
    ListTerm,
    Not,
    Number,
    Operator,
    Or,
    Plan,
    PlanTerm,
    Position,
    Relation,
    Rule,
    RuleTerm,
    Step,
    String,
    Structure,
    Term,
    Trigger,
    TriggerTerm,
    Variable,
    While,
)
from agentd.language.syntax_tree.printer import source_text
from tests.agentd.minds import run
from tests.agentd.mistakes import SYNTAX

CORPUS = Path(__file__).parents[2] / "conformance"
PROGRAMS = sorted(path for path in CORPUS.rglob("*.asl") if not path.with_suffix(".err").exists())


def atom(name: str, *args: Term) -> Structure:
    return Structure(name, args)


def action(name: str, *args: Term) -> Step:
    return Step(Operator.ACTION, Structure(name, args))


def only_plan(text: str) -> Plan:
    (plan,) = parse_program(text, "a.asl").items
    assert isinstance(plan, Plan)
    return plan


def body_of(text: str) -> tuple[object, ...]:
    return only_plan(f"+!g <- {text}.").body.formulas


def test_the_corpus_is_there() -> None:
    assert len(PROGRAMS) > 200


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_a_program_of_the_corpus_parses_with_no_warning_but_for_d1_and_prints_as_itself(path: Path) -> None:
    program = parse_file(path)
    assert bool(program.warnings) == ("// D1:" in path.read_text(encoding="utf-8")), program.warnings
    assert parse_program(source_text(program), str(path)).items == program.items


VALID = [json.loads(line) for line in (SYNTAX / "valid.txt").read_text(encoding="utf-8").splitlines()]
"""Programs that Jason takes, each with some rarely used notation."""


@pytest.mark.parametrize("text", VALID, ids=[text[:40] for text in VALID])
def test_valid_syntax_is_read_without_a_word_and_prints_as_itself(text: str) -> None:
    program = parse_program(text, "a.asl")
    assert program.warnings == ()
    assert parse_program(source_text(program), "a.asl").items == program.items


TERMS: list[tuple[str, Term]] = [
    ("12", Number(12.0)),
    (".5", Number(0.5)),
    ("1.5e-3", Number(0.0015)),
    ("1e20", Number(1e20)),
    (r'"a\nb\"c"', String('a\nb"c')),
    (r'"tab\t\\n"', String(r"tab\t\\n")),
    ("a", atom("a")),
    ("'Hello World'", atom("'Hello World'")),
    ("true", atom("true")),
    ("p(1)[x|R]", Structure("p", (Number(1.0),), ListTerm((atom("x"),), Variable("R")))),
    ("p[|R]", Structure("p", (), ListTerm((), Variable("R")))),
    ("p[]", Structure("p", (), ListTerm())),
    ("~p", Structure("p", negated=True)),
    ("ns::p(a)", Structure("p", (atom("a"),), namespace="ns")),
    ("::p", Structure("p", namespace="")),
    ("N::p", Structure("p", namespace=Variable("N"))),
    ("~ns::p", Structure("p", negated=True, namespace="ns")),
    ("ns::~p", Structure("p", negated=True, namespace="ns")),
    ("X", Variable("X")),
    ("_", Variable("_")),
    ("~X[a]", Variable("X", ListTerm((atom("a"),)), negated=True)),
    ("ns::X", Variable("X", namespace="ns")),
    (".f(1)", InternalAction(".f", (Number(1.0),))),
    (".map.put", InternalAction(".map.put")),
    ("math.pi", InternalAction("math.pi")),
    ("my.double(4)", InternalAction("my.double", (Number(4.0),))),
    ("[]", ListTerm()),
    ("[a,X|T]", ListTerm((atom("a"), Variable("X")), Variable("T"))),
    ("[a|[b]]", ListTerm((atom("a"),), ListTerm((atom("b"),)))),
    ("-X", Arithmetic("-", (Variable("X"),))),
    ("- 3", Arithmetic("-", (Number(3.0),))),
    ("5--2", Arithmetic("-", (Number(5.0), Arithmetic("-", (Number(2.0),))))),
    ("5 -2", Arithmetic("-", (Number(5.0), Number(2.0)))),
    ("X < 1", Relation("<", Variable("X"), Number(1.0))),
    ("P =.. L", Relation("=..", Variable("P"), Variable("L"))),
    ("a \\== b", Relation("\\==", atom("a"), atom("b"))),
    ("not p", Not(atom("p"))),
    ("a & b | c", Or(And(atom("a"), atom("b")), atom("c"))),
    ("not a & b", And(Not(atom("a")), atom("b"))),
    ("not X > 3", Not(Relation(">", Variable("X"), Number(3.0)))),
    ("f(a & b)", atom("f", And(atom("a"), atom("b")))),
    ("[(Y > 1)]", ListTerm((Relation(">", Variable("Y"), Number(1.0)),))),
    ("{ +!g }", TriggerTerm(Trigger("+", "!", atom("g")))),
    ("{ ^!g }", TriggerTerm(Trigger("^", "!", atom("g")))),
    ("{+b}", TriggerTerm(Trigger("+", "", atom("b")))),
    ("{ +!_ }", TriggerTerm(Trigger("+", "!", Variable("_")))),
    ("{ !a }", BodyTerm(Body((Step(Operator.ACHIEVE, atom("a")),)))),
    ("{ }", BodyTerm(Body())),
    ("{ h(X) :- b(X) }", RuleTerm(Rule(atom("h", Variable("X")), atom("b", Variable("X"))))),
]


@pytest.mark.parametrize(("text", "term"), TERMS, ids=[text for text, _ in TERMS])
def test_a_term_is_read_as_its_node(text: str, term: Term) -> None:
    assert parse_term(text) == term
    assert parse_term(source_text(term)) == term


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2+3*4", 14),
        ("10-4-3", 3),
        ("2**3**2", 512),
        ("-2**2", 4),
        ("4-3**2", -5),
        ("2**-1", 0.5),
        ("2 * -3", -6),
        ("7-3 mod 2", 6),
        ("20 div 3*2", 12),
        ("100/10/2", 5),
        ("-(-3)", 3),
    ],
)
def test_operators_bind_as_in_jason(text: str, value: float) -> None:
    assert evaluate(parse_term(text)) == value


def evaluate(term: Term) -> float:
    match term:
        case Number(value):
            return value
        case Arithmetic("-", (operand,)):
            return -evaluate(operand)
        case Arithmetic(operator, (left, right)):
            a, b = evaluate(left), evaluate(right)
            return {
                "+": lambda: a + b,
                "-": lambda: a - b,
                "*": lambda: a * b,
                "/": lambda: a / b,
                "**": lambda: float(a**b),
                "div": lambda: a // b,
                "mod": lambda: a % b,
            }[operator]()
    raise AssertionError(term)


@pytest.mark.parametrize(
    ("text", "trigger"),
    [
        ("+b", Trigger("+", "", atom("b"))),
        ("-b(X)", Trigger("-", "", atom("b", Variable("X")))),
        ("+!g", Trigger("+", "!", atom("g"))),
        ("-!g", Trigger("-", "!", atom("g"))),
        ("+?g", Trigger("+", "?", atom("g"))),
        ("-?g", Trigger("-", "?", atom("g"))),
        ("+~b", Trigger("+", "", Structure("b", negated=True))),
        ("+!sea::go", Trigger("+", "!", Structure("go", namespace="sea"))),
        ("^!g[state(S)]", Trigger("^", "!", Structure("g", (), ListTerm((atom("state", Variable("S")),))))),
        ("+X", Trigger("+", "", Variable("X"))),
    ],
)
def test_every_kind_of_trigger_is_read(text: str, trigger: Trigger) -> None:
    assert parse_trigger(text) == trigger
    assert parse_trigger("{ " + text + " }") == trigger
    assert only_plan(f"{text} <- a.").trigger == trigger


STEPS: list[tuple[str, object]] = [
    ("a(1)", action("a", Number(1.0))),
    (".print", Step(Operator.ACTION, InternalAction(".print"))),
    ("X", Step(Operator.ACTION, Variable("X"))),
    ("X = 1", Step(Operator.ACTION, Relation("=", Variable("X"), Number(1.0)))),
    ("-X = Y", Step(Operator.ACTION, Relation("=", Arithmetic("-", (Variable("X"),)), Variable("Y")))),
    ("not p", Step(Operator.ACTION, Not(atom("p")))),
    ("true", action("true")),
    ("!g", Step(Operator.ACHIEVE, atom("g"))),
    ("!!G", Step(Operator.ACHIEVE_NEW_FOCUS, Variable("G"))),
    ("?b(X)", Step(Operator.TEST, atom("b", Variable("X")))),
    ("?(a & b)", Step(Operator.TEST, And(atom("a"), atom("b")))),
    ("+b", Step(Operator.ADD, atom("b"))),
    ("-~b", Step(Operator.DELETE, Structure("b", negated=True))),
    ("-+b", Step(Operator.UPDATE, atom("b"))),
    ("++b", Step(Operator.ADD_NEW_FOCUS, atom("b"))),
    ("--b", Step(Operator.DELETE_NEW_FOCUS, atom("b"))),
    ("+<b", Step(Operator.ADD_FIRST, atom("b"))),
    ("+>b", Step(Operator.ADD_LAST, atom("b"))),
    ("+ns::b", Step(Operator.ADD, Structure("b", namespace="ns"))),
    ("+X", Step(Operator.ADD, Variable("X"))),
    ("+{ h :- b }", Step(Operator.ADD, RuleTerm(Rule(atom("h"), atom("b"))))),
    ("+{ +!g }", Step(Operator.ADD, PlanTerm(Plan(Trigger("+", "!", atom("g")))))),
    ("+{ +b }", Step(Operator.ADD, PlanTerm(Plan(Trigger("+", "", atom("b")))))),
    ("{ +b }", Step(Operator.ACTION, BodyTerm(Body((Step(Operator.ADD, atom("b")),))))),
    ("(a; b)", Step(Operator.ACTION, BodyTerm(Body((action("a"), action("b")))))),
    ("while (a) { b }", While(atom("a"), Body((action("b"),)))),
    ("for (a) { }", For(atom("a"), Body())),
    (
        "if (a) { b } elif (c) { d; } else { e }",
        If(((atom("a"), Body((action("b"),))), (atom("c"), Body((action("d"),)))), Body((action("e"),))),
    ),
    ("a |&| (b; c)", Fork("|&|", (Body((action("a"),)), Body((action("b"), action("c")))))),
    (
        "a |&| b ||| { c }",
        Fork("|||", (Body((Fork("|&|", (Body((action("a"),)), Body((action("b"),)))),)), Body((action("c"),)))),
    ),
]


@pytest.mark.parametrize(("text", "step"), STEPS, ids=[text for text, _ in STEPS])
def test_a_formula_of_a_body_is_read_as_its_node(text: str, step: object) -> None:
    assert body_of(text) == (step,)
    assert body_of(f"a; {text}; b") == (action("a"), step, action("b"))


def test_a_semicolon_may_be_left_out_after_a_block_and_put_before_the_end() -> None:
    assert len(body_of("if (a) { b } c; while (d) { e; } f;")) == 4


def test_a_plan_has_label_context_goal_condition_body_and_sub_plans() -> None:
    plan = only_plan("@l[atomic, cost(3)] +!g(X) : a & b <: done(X) <- c; d. { +e. @m -f <- h. { +i. } }")
    assert plan.label == Structure("l", (), ListTerm((atom("atomic"), atom("cost", Number(3.0)))))
    assert plan.context == And(atom("a"), atom("b"))
    assert plan.goal_condition == atom("done", Variable("X"))
    assert plan.body.formulas == (action("c"), action("d"))
    assert [sub.trigger.literal for sub in plan.subplans] == [atom("e"), atom("f")]
    assert [sub.trigger.literal for sub in plan.subplans[1].subplans] == [atom("i")]


def test_a_goal_condition_may_stand_before_the_context() -> None:
    assert only_plan("+!g <: c : a <- b.") == only_plan("+!g : a <: c <- b.")


@pytest.mark.parametrize("text", ["@[x] +!g.", "@'Quoted label' +!g.", "@l(1) +!g."])
def test_labels_are_quoted_structured_or_annotations_only(text: str) -> None:
    label = only_plan(text).label
    assert isinstance(label, Structure)
    assert source_text(label) == text[1:-5]


@pytest.mark.parametrize("text", ["+!g.", "+!g : c.", "+!g <- true."])
def test_plans_may_have_no_body(text: str) -> None:
    plan = only_plan(text)
    assert plan.body.formulas == ((action("true"),) if "true" in text else ())


def test_items_come_in_file_order() -> None:
    program = parse_program("b(1). !g. r(X) :- b(X). +!g <- a. ~c[x]. ns::d.", "a.asl")
    assert [type(item) for item in program.items] == [Belief, Goal, Rule, Plan, Belief, Belief]


def test_directives_enclose_their_items() -> None:
    text = '{ include("f.asl", n) } { begin namespace(m) } b. { begin dg(g) } +!g. { end } c. { end } { register_x }'
    include, block, last = parse_program(text, "a.asl").items
    assert include == Directive(atom("include", String("f.asl"), atom("n")))
    assert last == Directive(atom("register_x"))
    assert isinstance(block, Directive)
    inner = block.items[1]
    assert isinstance(inner, Directive)
    assert inner.name == atom("dg", atom("g"))
    assert [type(item) for item in block.items] == [Belief, Directive, Belief]


def test_begin_and_end_are_names_elsewhere() -> None:
    assert list(parse_program("begin. end(1).", "a").items) == [Belief(atom("begin")), Belief(atom("end", Number(1.0)))]


def test_plan_terms_may_have_variables_everywhere() -> None:
    term = parse_term("{ @L +!T : C <- B }")
    plan = Plan(
        Trigger("+", "!", Variable("T")), Variable("C"), Body((Step(Operator.ACTION, Variable("B")),)), Variable("L")
    )
    assert term == PlanTerm(plan)
    steps = (Step(Operator.ACTION, Variable("H")), Step(Operator.ACTION, Variable("T")))
    assert parse_term("{ H; T }") == BodyTerm(Body(steps))


def test_every_node_knows_where_it_begins() -> None:
    plan = only_plan('@l +!g(X)\n  : p(X)\n  <- .print("a",\n       X);\n     !h.')
    assert plan.position == Position("a.asl", 1, 1)
    assert plan.trigger.position == Position("a.asl", 1, 4)
    assert isinstance(plan.context, Structure)
    assert plan.context.position == Position("a.asl", 2, 5)
    first, second = plan.body.formulas
    assert isinstance(first, Step)
    assert isinstance(first.term, InternalAction)
    assert first.term.args[1] == Variable("X")
    assert first.term.args[1].position == Position("a.asl", 4, 8)
    assert second.position == Position("a.asl", 5, 6)


def test_a_plan_from_text_may_lack_its_dot() -> None:
    assert parse_plan("+!g <- a") == parse_plan("+!g <- a.")
    assert parse_plan("@l +!g").label == atom("l")


def test_a_formula_is_read_alone() -> None:
    assert parse_formula("rescued_all & not lost(_)") == And(atom("rescued_all"), Not(atom("lost", Variable("_"))))
    with pytest.raises(SyntaxErrors, match="can be true or false"):
        parse_formula("3")


def test_a_literal_is_read_alone() -> None:
    assert parse_literal("rescuers(2)") == atom("rescuers", Number(2.0))
    for text in ("X", "3", "a & b", "a b", ""):
        with pytest.raises(SyntaxErrors):
            parse_literal(text)


def test_comments_stand_between_any_tokens_and_not_in_strings() -> None:
    text = '/* a * / */ b(/**/1 // c\n). /***/ c("// no", "/* no */").'
    assert parse_program(text, "a").items == (
        Belief(atom("b", Number(1.0))),
        Belief(atom("c", String("// no"), String("/* no */"))),
    )


# --- deviation D1 ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "+!g <- takeoff(5)\n !h.",
        '+!g <- .print("a")\n .print("b").',
        "+!g <- !a; land // now\n +done.",
        "+!g <- .wait(1)\n -+b(1).",
        "+!g <- if (a) { act(X)[slow]\n ?b }.",
        "+!g <- .print\n X = 1.",
        "+!g <- ns::act(f(1), [g(2)])\n if (a) { b }.",
        "+!g <- if (a) { b } act(1)\n while (c) { d }.",
        "+!g <- !a\n !b.",
        "+!g <- !a(1)[x]\n .print(b).",
        "+!g <- !!ns::a\n ?b(X).",
        "+!g <- !X\n +b.",
        "+!g <- ?b(X)\n !c(X).",
        "+!g <- ?b(X)\n +c(X).",
        "+!g <- ?(X > 1 & b)\n c.",
        "+!g <- +b(1)\n +c(2).",
        "+!g <- -+b(1)\n -~c.",
        "+!g <- +<b\n !c.",
        "+!g <- X = f(1)\n !b.",
        "+!g <- X = 1\n Y = 2.",
        "+!g <- X = Y + 1\n +done.",
        "+!g <- ?X > 1\n -~a(X).",
        '+!g <- X = "a" | b\n if (c) { d }.',
        "+!g <- X > 1\n not b.",
        "+!g <- X\n a.",
        "+!g <- !a |&| !b\n !c.",
        "+!g <- if (a) { !b\n !c }.",
    ],
)
def test_a_missing_semicolon_before_a_new_line_that_can_only_begin_a_formula_is_a_warning(text: str) -> None:
    program = parse_program(text, "a.asl")
    (warning,) = program.warnings
    assert (warning.file, warning.line, warning.severity) == ("a.asl", 2, "warning")
    assert "line 2" in warning.message
    with_semicolon = text.replace(" // now", "").replace("\n", ";\n")
    assert program.items == parse_program(with_semicolon, "a.asl").items


def test_several_lines_without_semicolon_give_a_warning_each() -> None:
    program = parse_program('+!g <-\n .print("a")\n .print("b")\n c\n !d.', "a.asl")
    assert [warning.line for warning in program.warnings] == [3, 4, 5]


@pytest.mark.parametrize(
    "text",
    [
        "+!g <- a b.",
        "+!g <- !a !b.",
        "+!g <- X = 1 !b.",
        "+!g <- !a\n+!h <- b.",
        "+!g <- !a\nb(1).",
        "+!g <- if (a)\n b.",
        "+!g <- (a\n b).",
        "+!g <- X = {a}\n b.",
        "+!g <- X = [a\n b].",
        "+!g <- .add_plan({+!h : a\n b <- c}).",
        "+!g : a\n b <- c.",
        "b(1)\nb(2).",
        "+!g <- f(a\n b).",
    ],
)
def test_a_missing_semicolon_elsewhere_stays_an_error(text: str) -> None:
    with pytest.raises(SyntaxErrors):
        parse_program(text, "a.asl")


@pytest.mark.parametrize(
    "text",
    [
        "+!g <- X = 5\n div 2.",
        "+!g <- X = Y\n + math.abs(Z).",
        "+!g <- ?X > 1\n - Y.",
        "+!g <- X = .length(L)\n + 1.",
        "+!g <- X = math.max(1,2)\n - Y.",
        "+!g : .f(X)\n & b <- c\n & d.",
    ],
)
def test_an_expression_may_go_on_in_the_next_line(text: str) -> None:
    assert parse_program(text, "a.asl").warnings == ()


# --- size ------------------------------------------------------------------------------------------------------------

DEPTH = 10_000


@pytest.mark.parametrize(
    "text",
    [
        "b(" + "[" * DEPTH + "]" * DEPTH + ").",
        "+!g <- X = " + "(" * DEPTH + "1" + ")" * DEPTH + ".",
        "b(" + "f(" * DEPTH + "1" + ")" * DEPTH + ").",
        "+!g <- X = " + "- " * DEPTH + "1.",
        "+!g <- X = 1" + "+1" * DEPTH + ".",
        "+!g : a" + " & a" * DEPTH + " <- b.",
        "+!g <- X = " + "2**" * DEPTH + "1.",
        "+!g <- " + "a;" * DEPTH + "a.",
        "b([" + "a," * DEPTH + "a]).",
    ],
    ids=lambda text: text[:12],
)
def test_depth_and_length_are_no_problem(text: str) -> None:
    program = parse_program(text, "deep.asl")
    assert source_text(program)


@pytest.mark.parametrize(
    "text",
    [
        "+!g <- " + "{" * DEPTH + "a" + "}" * DEPTH + ".",
        "+!g <- " + "if (a) {" * 101 + "a" + "}" * 101 + ".",
        "+!g <- " + "if (b) { c } else {" * 101 + "a" + "}" * 101 + ".",
        "+!g <- " + "while (a) {" * 101 + "a" + "}" * 101 + ".",
        "+!g <- " + "for (a) {" * 101 + "a" + "}" * 101 + ".",
        "+!g <- " + "(a; " * 101 + "a" + ")" * 101 + ".",
        "+!g <- " + "(a |&| " * 101 + "b" + ")" * 101 + ".",
        "+!g <- " + "(a ||| " * DEPTH + "b" + ")" * DEPTH + ".",
        "+!g. " + "{ +!g. " * 101 + "}" * 101,
        "{ begin dg(g) }" * 101 + "{ end }" * 101,
    ],
    ids=lambda text: text[:20],
)
def test_what_is_nested_beyond_a_hundred_is_refused_once(text: str) -> None:
    with pytest.raises(SyntaxErrors) as caught:
        parse_program(text, "deep.asl")
    (finding,) = caught.value.findings
    assert "blocks are nested more than 100 deep" in finding.message


def test_a_hundred_blocks_may_stand_one_inside_the_other() -> None:
    assert run("!s. +!s <- " + "if (1 < 2) { " * 99 + ".print(inside)" + " }" * 99 + ".").prints == ["inside"]


def test_what_is_nested_deep_and_not_closed_is_reported_in_one_line() -> None:
    with pytest.raises(SyntaxErrors) as caught:
        parse_program("+!g <- X = " + "(" * DEPTH + ".", "deep.asl")
    (finding,) = caught.value.findings
    assert "not closed" in finding.message


def test_a_program_of_1000_plans_parses_in_time() -> None:
    plan = """@p{i}[atomic] +!go{i}(X, Y)[source(S)] : position(X, Z) & Z > {i} & not blocked(X, Y) | ready(S)
       <- .print("going ", X, " to ", Y); ?distance(X, Y, D);
          if (D > 10 & fuel(F)) {{ !refuel(F + {i} * 2); -+fuel(100) }} else {{ .wait(500) }}
          .send(S, tell, arrived(X, [Y, Z | T])); !!next(go{i}, D / 2 - 1).\n"""
    text = "".join(plan.format(i=i) for i in range(1000))
    parse_program(plan.format(i=0), "warm.asl")
    begin = time.process_time()
    program = parse_program(text, "big.asl")
    assert time.process_time() - begin < 5.0  # 0.5 s on one free core; the bound allows for slow and busy machines
    assert len(program.items) == 1000


def test_the_shipped_tables_are_those_of_the_grammar() -> None:
    grammar = Path(parse_tables.__file__).with_name(parse_tables.GRAMMAR).read_text(encoding="utf-8")
    shipped, made = parse_tables.load(), parse_tables.compile_grammar(grammar)
    assert shipped.digest == made.digest, (
        "run: python -m agentd.language.parser.parse_tables > agentd/language/parser/grammar.json"
    )
    assert len(shipped.states) == len(made.states)
    assert sorted(map(repr, shipped.rules)) == sorted(map(repr, made.rules))


def test_tables_survive_being_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grammar = 'program: "a" program | NAME\nlone_expression: NAME\nlone_literal: NAME\nlone_plan: NAME\n'
    made = parse_tables.compile_grammar(grammar + "lone_trigger: NAME\nNAME: /[b-z]+/\n")
    texts = {
        parse_tables.GRAMMAR: grammar + "lone_trigger: NAME\nNAME: /[b-z]+/\n",
        parse_tables.TABLES: parse_tables.dump(made),
    }
    monkeypatch.setattr(parse_tables, "_resource", texts.__getitem__)
    parse_tables.load.cache_clear()
    try:
        assert parse_tables.load() == made
        texts[parse_tables.GRAMMAR] += "// edited\n"
        parse_tables.load.cache_clear()
        assert parse_tables.load().digest != made.digest
    finally:
        parse_tables.load.cache_clear()


def test_agents_that_run_one_file_share_its_syntax_tree_and_an_edited_file_is_read_again(tmp_path: Path) -> None:
    (file := tmp_path / "a.asl").write_text("!go. +!go <- .print(1).")
    program = parse_file(file)
    assert parse_file(file) is program
    file.write_text("!go. +!go <- .print(2).")
    assert parse_file(file).items[1] != program.items[1]


def test_nodes_that_say_the_same_are_equal_wherever_they_are() -> None:
    one, other = (parse_program(f"{before}+!g(X) : p(X) <- .print(X).", "a.asl").items[0] for before in ("", "\n  "))
    assert one.position != other.position
    assert one == other
    assert (one != other) is False
    assert hash(one) == hash(other)
