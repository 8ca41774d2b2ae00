// Makes one agent per file of cases, waits until each has told its results, and stops the team with what came of it.

timeout(20000).
results(0, 0).                                  // passed, failed

!judge.

@judging +!judge : .my_name(judge)
  <- .log(info, "looking for cases");
     .list_files("cases", ".*_case[.]asl", Files);
     for (.member(File, Files)) {
         !name_of(File, Name);
         .create_agent(Name, File);
         +candidate(Name);
     };
     ?timeout(Most);
     .wait(not candidate(_), Most);
     !verdict.

-!judge[error(wait_timeout)]
  <- .findall(C, candidate(C), Missing);
     .log(severe, "no word from ", Missing);
     .stopMAS(0, 3).

+!name_of(File, Name)                           // "cases/arithmetic_case.asl" -> arithmetic_case
  <- .findall(P, .substring("/", File, P), Slashes);
     .max(Slashes, Last);
     .length(File, Length);
     .substring(File, Text, Last + 1, Length - 4);
     .term2string(Name, Text).

@count_pass[atomic] +!count(passed) : results(P, F) <- -+results(P + 1, F).
@count_fail[atomic] +!count(failed) : results(P, F) <- -+results(P, F + 1).

+!outcome(Plan, passed)[source(Who)]
  <- .log(fine, Who, " passed ", Plan);
     !count(passed).

+!outcome(Plan, failed, Why, File, Line)[source(Who)] : .string(File) & .number(Line)
  <- .log(warning, Who, ": ", Plan, " failed at ", File, ":", Line, ": ", Why);
     !count(failed).

+finished(Agent)[source(Agent)]
  <- -candidate(Agent);
     .kill_agent(Agent).

+!verdict : results(P, 0) <- .log(info, P, " passed"); .stopMAS.
+!verdict : results(P, F) <- .log(severe, P, " passed, ", F, " failed"); .stopMAS(0, 1).
