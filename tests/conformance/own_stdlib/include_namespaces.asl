// .include loads a file into the default, a named or a new namespace; a missing file is logged and no failure.
// Expected from the specification, not recorded from Jason.
b(1).
@lb +!g <- .print("g").
!start.
+!start
   <- .save_agent("part.asl"); .include("part.asl", one); .include("part.asl", Two); .wait(50);
      if (.namespace(Two) & not Two == default & not Two == one) { .print("a new one") }
      ?one::b(X); .print(X); .findall(Y, Two::b(Y), L); .print(L);
      !one::g; .include("missing.asl"); .print("goes on"); !t(1); !t(2); !t(3).
+!t(1) <- .include(part); .print("not here").
+!t(2) <- .include("part.asl", "two"); .print("not here").
+!t(3) <- .include; .print("not here").
-!t(N)[error(E)] <- .print(N, " ", E).
