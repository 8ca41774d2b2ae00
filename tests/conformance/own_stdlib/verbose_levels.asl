// .verbose(0) prints without the name of the agent, 2 shows what is logged below info.
// Expected from the specification, not recorded from Jason.
!start.
+!start
   <- .verbose(0); .print("plain"); .println(2); .printf("%s", x); .log(info, "logged");
      .verbose(1); .print("with name"); .log(fine, "not here");
      .verbose(2); .log(fine, "fine"); .print("debugging"); !t.
+!t <- .verbose(loud); .print("not here").
-!t[error(E)] <- .print(E).
