// Assertion plans: each finds the plan that makes it in its own intention, mails the result with the line of that plan,
// and goes on whatever the result is.

asserting(Name, File, Line) :-
   .intention(_, _, [im(Label, { +!Goal }, _, _)|_], current) &
   Goal =.. [_, Name, _, _] &
   _[code_src(File), code_line(Line)] = Label.
asserting(nobody, "nowhere", 0).                // a plan for something else makes it

alike(X, Y) :- .list(X) & .list(Y) & not lacks(X, Y) & not lacks(Y, X).
alike(X, Y) :- not .list(X) & not .list(Y) & X == Y.
lacks(X, Y) :- .member(M, Y) & not .member(M, X).

@equal[atomic] +!assert_equals(X, Y) : alike(X, Y) & asserting(Name, File, Line)
  <- !mail(passed, Name, File, Line, [X, " equals ", Y]).
@unequal[atomic] +!assert_equals(X, Y) : asserting(Name, File, Line)
  <- !mail(failed, Name, File, Line, ["expected ", X, ", got ", Y]).

@close[atomic] +!assert_equals(X, Y, By) : math.abs(X - Y) <= By & asserting(Name, File, Line)
  <- !mail(passed, Name, File, Line, [X, " is near ", Y]).
@apart[atomic] +!assert_equals(X, Y, By) : asserting(Name, File, Line)
  <- !mail(failed, Name, File, Line, ["expected ", X, " within ", By, ", got ", Y]).

@holds[atomic] +!assert_true(Formula) : Formula & asserting(Name, File, Line)
  <- !mail(passed, Name, File, Line, [Formula]).
@holds_not[atomic] +!assert_true(Formula) : asserting(Name, File, Line)
  <- !mail(failed, Name, File, Line, ["expected ", Formula]).

@lacking[atomic] +!assert_false(Formula) : not Formula & asserting(Name, File, Line)
  <- !mail(passed, Name, File, Line, ["not ", Formula]).
@not_lacking[atomic] +!assert_false(Formula) : asserting(Name, File, Line)
  <- !mail(failed, Name, File, Line, ["expected not ", Formula]).

@member[atomic] +!assert_contains(Whole, Part) : .member(Part, Whole) & asserting(Name, File, Line)
  <- !mail(passed, Name, File, Line, [Part, " in ", Whole]).
@no_member[atomic] +!assert_contains(Whole, Part) : asserting(Name, File, Line)
  <- !mail(failed, Name, File, Line, ["expected ", Part, " in ", Whole]).

@within[atomic] +!assert_between(X, Low, High) : Low <= X & X <= High & asserting(Name, File, Line)
  <- !mail(passed, Name, File, Line, [X]).
@out[atomic] +!assert_between(X, Low, High) : asserting(Name, File, Line)
  <- !mail(failed, Name, File, Line, ["expected ", Low, " <= ", X, " <= ", High]).

@forced[atomic] +!force_failure(Why) : asserting(Name, File, Line)
  <- !mail(failed, Name, File, Line, [Why]).

+!mail(Verdict, Name, File, Line, Parts)
  <- !joined(Parts, "", Text);
     .send(manager, achieve, result(Verdict, Name, File, Line, Text)).

+!joined([], Text, Text).
+!joined([Part|Parts], Before, Text) <- .concat(Before, Part, More); !joined(Parts, More, Text).
