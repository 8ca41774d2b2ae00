// The test manager: makes an agent of each file of cases, counts the results that they mail, and stops the team by them.
// Start it in the folder that has `cases` and `suite`: an agent `manager` of this file.

patience(20000).                                // ms for all cases together
count(passed, 0). count(failed, 0). count(broken, 0).

!manage.

+!manage
  <- .print("looking for cases");
     .list_files("cases", ".*_case[.]asl", Files);
     for (.member(File, Files)) {
        !agent_of(File, Name);
        +running(Name);
        .create_agent(Name, File)
     };
     ?patience(Most);
     .wait(not running(_), Most);
     !verdict.

-!manage[error(wait_timeout)]
  <- .setof(Name, running(Name), Silent);
     .print("no word from ", Silent);
     .stopMAS(0, 3).

+!agent_of(File, Name)                          // "cases/arithmetic_case.asl" -> arithmetic_case
  <- .findall(P, .substring("/", File, P), Slashes);
     .max(Slashes, Last);
     .length(File, Length);
     .substring(File, Text, Last + 1, Length - 4);
     .term2string(Name, Text).

@passing[atomic] +!result(passed, _, _, _, _) <- !one_more(passed).
@telling[atomic] +!result(Verdict, Test, File, Line, Text)[source(Tester)]
  <- .print(Tester, ": ", Test, " ", Verdict, " at ", File, ":", Line, ": ", Text);
     !one_more(Verdict).

+!one_more(Verdict)
  <- ?count(Verdict, N);
     -count(Verdict, N);
     +count(Verdict, N + 1).

+finished(Tester)[source(Tester)]
  <- -running(Tester);
     .kill_agent(Tester).

+!verdict : count(passed, P) & count(failed, F) & count(broken, B)
  <- .print(P, " passed, ", F, " failed, ", B, " broken");
     if (F + B > 0) { .stopMAS(0, 1) } else { .stopMAS }.
