"""Odd but valid syntax is read, without a word, and prints as itself."""

# ruff: noqa: E501

from __future__ import annotations

import pytest

from agentd.language.parse import parse_program
from agentd.language.syntax_tree.printer import source_text

VALID = (
    "+!g : true <- true.",
    "b(1)[source(self), x].",
    "~b(1). ns::b(1). ~ns::b. ns::~b. default::c. ::d.",
    "-b. -!g. +?b(X) : c <- d. -?q.",
    "!g[x]. !ns::g(1).",
    "@l[atomic,priority(3)] +!g. @l2(1,X) +!h. @'quoted label' +!i. @[atomic] +!j. @n::l +!k.",
    "+!g <- !a; !!b; ?c; +d; -e; -+f; ++h; --i; +<j; +>k; .print(x); X = 3; act; X > 2; X == 3; X \\== 4.",
    "+!g <- if (X) {} else {} if (a & not b | c) { d; } elif (e) { f } else { } for (a(X)) { b }; while (c) { d; e; }; g;.",
    'b("a\\nb\\"c//d/*e", "", "é ü — “ ”", "%s # $").',
    "b('a b', '', 'ü').",
    '{ include("$jasonJar/x.asl") } { include("a.asl", ns) } { register_function("my.f", 2, "r") } { register_function("p.C") }',
    "+!g <- { a; b }; (a; b) |&| (c; d) |&| e; a ||| b ||| (c; d); (a |&| b) ||| c.",
    "+!g <- X = { +!g }; Y = { -!g(_) }; Z = { @l[x] +!g : c <- b; d }; W = { a(X) :- b(X) & c }; V = { }; U = { !a; ?b }; T = { +b }; S = { +!g <- a }; R = { ^!g[state(s)] }.",
    "+!g <- X = -3; Y = - 3; Z = 2*-3; W = X mod 2 + X div 2; V = 2**-1; U = (1+2)*3 - -4; T = .5 + 1.5e10 + 1E3 + 1e-3 + 007; S = -(Y+1); R = -X; Q = 5--2; P = X--1.",
    "+!g <- a.b.c(X); jia.foo(X); my.pkg.Foo(X); .list_x.foo(X); .my.act; .a1(X).",
    'b([H|T], [H|_], [a,b|[c]], [[]|X], [], [[1],[2,[3]]], [a,-1,"x",X+1,{a},{+!g}]).',
    "b(_, _X, __, X1, X_y) .",
    "a :- true. a :- false. a :- .print(x). a :- X = 1 & Y > 2 | not (c & d) & (e | f). a :- not ~b. a :- not .member(X,L). a :- not X > 3. a :- (not (not b)).",
    "+b[source(A)] : A \\== self & b(X)[source(A), c(_)|R] <- -b[source(A)].",
    "+!g <: c <- a. +!g : x <: c. +!g <: c : x. +!g <- !s. { +!s <- a. @l -!s <- b. } +!h.",
    '+b[a([1,2]), t(X,"s"), "str", 3, [x]|R] <- c.',
    '+!g <- .send(bob, achieve, go(1)); .wait("+b(X)", 100); .wait({+b(X)}, 100, E).',
    "+!g <- +b[x]; -b[x]; -+b(1)[x]; ?b(X)[source(Y)]; ?(a & b); ?(not a); ?X > 3; ?math.abs(X) > 3.",
    "+!g <- !X; !!X; +X; -X; ?X; X; -+X.",
    "a :- N::p(X) & ::p & N::Y. +ns::b <- !ns::g; +ns::c; ?ns::d; ns::e.",
    "+!g<-for(.member(X,[1,2])){.print(X)}.",
    "b(1).\r\n+!g\r\n\t<- a;\r\n\tb.\r\n",
    "b.\x0c c.",
    "/* a */b/**/(/*x*/1/***/)/** doc **/./* * / */ // end",
    '+!g/*x*/:/*y*/a/**/<-//z\nb/*"*/;/*\'*/c.// +!h <- "',
    "{ begin namespace(n, local) } b. { end } { begin dg(g) } +!g. { end }",
    "+!g : not (a & b) <- c. +!g : not(a) & b <- c. +!g : not a & b | c <- d. +!g : a | b & c <- d. +!g : ((a)) <- c.",
    "begin. end. include(x). namespace(y). elseif(z). then. do. foreach(a). begin(1) :- end(2).",
    "+!g <- if (.count(b(_)) > 3 & X mod 2 == 0) { if (a) { b } else { if (c) { d } } }.",
    "+!g <- f(a & b); f(not a); f(X > 3); f({a;b}); f(a | b); f((a)); f(a, (b & c)); f(X = Y); f(1 < 2).",
    "+!g <- Y = p[b|R]; ~X = ~q; X[source(S)] = Z.",
    '+!g <- jason.stdlib.print("x").',
    "^!g[state(S)] : S \\== x <- a. ^?q <- b.",
    "+!g[A|B]. +!g[source(self)|_]. -!g[error(E),error_msg(M)] <- .print(E,M).",
    "+!g <- a(1)\n   [x].",
    "+!g <-\n\n\n a\n ;\n b\n .\n",
    "!g. +!g. !h.",
    "+!g(1). +!g(1.5). +!g(X) : X = 1.5. +!g(X):X=1.",
    '+!g <- .print(1.5);.print("a").',
    "+!g <- X=1;Y=2;.print(X,Y).",
    "+!g<-.print(a);!b;?c(X);+d(X);-e;-+f(X).",
    "+!g <- not a.",
    "p :- a & b.\np :- not a & not b.",
    "+!start : .my_name(bob) & .date(Y,M,D) <- .print(Y).",
    "vl(X) :- X = [1,2|T] & T = [3]. r(X,Y) :- X =.. [a,[Y],[]].",
    "+!g <- .findall(X, (a(X) & b(X)), L); .findall(p(X,Y), a(X) & b(Y), M); .setof(X, a(X) | b(X), N).",
    "+!g <- .fork(and, {a;b}, {c}); .if_then_else(a, {b}, {c}).",
    "@a +!g <- b. @b +!h <- c.",
    "+!g <- !g2 |&| !g3; !g4.",
    "+!g <- +{ r(X) :- b(X) }; -{ r(X) :- b(X) }; +{ +!h <- a }; +<{ +!h <- a }.",
    "+!g <- .print('single', \"double\").",
    "fuel(100) [unit(litre)].",
    "+!g : a [x] <- b [y].",
    "- ! g <- a.",
    "+ b <- - c.",
    "+!g <- ! a; ? b; + c; - d; !! f.",
    "b(X) :- X > -1. b(X) :- X>-1. b(X):-X<1&X>=-1&X<=1.",
    "b(a,\n  b, // c\n  c).",
    "likes(john,_). p(X) :- q(_,X,_).",
    "+!g <- a; // c\n b; /* d */ c.",
    "+temp(X)[source(percept)] : X > 30 & not on(ac) <- turn_on(ac).",
    "+!g(N) : N mod 2 == 0 & N div 2 > 1 <- !g(N-1). +!g(N) <- X = N * (N + 1) / 2.",
    "+!g <- ?(b(X) & X > 3); ?((b(X) | c(X)) & not d).",
)
"""Programs that Jason takes, each with some rarely used notation."""


@pytest.mark.parametrize("text", VALID, ids=[text[:40] for text in VALID])
def test_valid_syntax_is_read_without_a_word_and_prints_as_itself(text: str) -> None:
    program = parse_program(text, "a.asl")
    assert program.warnings == ()
    assert parse_program(source_text(program), "a.asl").items == program.items
