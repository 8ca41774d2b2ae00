// Goal patterns: sga adopts a goal for each event, one after the other.
{ begin sga({ +order(X) }, ready, serve(X)) }
{ end }
{ begin sga("+call(X)", "ready & X > 0", "answer(X)") }
{ end }
ready.
!s.
+!s <- ++order(1); .wait(20); ++order(2); .wait(300); ++call(0); ++call(1); .wait(100); .print(end).
+!serve(X) <- .print("serving ", X); .wait(50); .print("served ", X).
+!answer(X) <- .print("answer ", X).
