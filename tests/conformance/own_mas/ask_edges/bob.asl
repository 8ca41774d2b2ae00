// Questions to nobody, to a list with an unknown member, to oneself and others, with time limits, and answers that do not fit.
// Expected from the specification, not recorded from Jason.
// order: per-agent
v(7). v(8). ~w(1).
+?slow(X) <- .wait(300); X = 1.
+?broken(X) <- .fail(oops).
+?tested(X) <- ?nothing(X).
