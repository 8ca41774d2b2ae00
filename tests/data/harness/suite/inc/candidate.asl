// Runs the plans with the annotation `test` of the program that includes this file, in their order.

{ include("$suite/inc/checks.asl") }

!try_all.

@try_all[atomic] +!try_all
  <- .relevant_plans({+!_}, Plans, Labels);
     .length(Plans, N); .length(Labels, N);
     !try_each(Plans, Labels);
     .my_name(Me);
     .send(judge, tell, finished(Me)).

+!try_each([], []).
+!try_each([Plan|Plans], [Label|Labels]) : { @L[test] +!Goal : Context <- Body } = Plan
  <- Label =.. [_, Name, _, Annots];
     .member(test, Annots);
     -+trying(Name);
     !try(Name, Goal);
     !try_each(Plans, Labels).
+!try_each([_|Plans], [_|Labels]) <- !try_each(Plans, Labels).

+!try(Name, Goal)
  <- !Goal;
     .send(judge, achieve, outcome(Name, passed)).

-!try(Name, Goal)[code(Code), code_src(File), code_line(Line), error(Error), error_msg(Why)]
  <- .concat(Error, ": ", Why, " in ", Code, Text);
     .send(judge, achieve, outcome(Name, failed, Text, File, Line)).
