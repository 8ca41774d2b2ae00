// The tester agent: runs the plans of its program whose label has the annotation `test`, in their order, and mails what
// came of them to the manager. A case includes this file; its own plans for setup and teardown come first.

{ include("asserts.asl") }

!run_tests.

+!run_tests
  <- .add_plan([{ @no_setup +!setup }, { @no_teardown +!teardown }], self, end);
     .relevant_plans({ +!_ }, Plans, Labels);
     !run_each(Plans, Labels);
     .my_name(Me);
     .send(manager, tell, finished(Me)).

+!run_each([], []).
+!run_each([Plan|Plans], [Label|Labels]) : _[test] = Label & Plan =.. [_, Trigger, _, _] & Trigger = { +!Goal }
  <- Label =.. [_, Name, _, _];
     !setup;
     !run(Name, Goal);
     !teardown;
     !run_each(Plans, Labels).
+!run_each([_|Plans], [_|Labels]) <- !run_each(Plans, Labels).

+!run(_, Goal) <- !Goal.

-!run(Name, _)[error(Error), error_msg(Why), code(Formula), code_src(File), code_line(Line)]
  <- .concat(Error, ": ", Why, " in ", Formula, Text);
     .send(manager, achieve, result(broken, Name, File, Line, Text)).
