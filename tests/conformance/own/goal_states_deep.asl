// States of goals below others, in forks, of goals whose callers have the failure plan, and why one waits.
// Expected from rules 8.1 to 8.4, not recorded from Jason.
!start.
^!outer[state(S)] <- .print("outer ", S).
^!inner[state(S)] <- .print("    inner ", S).
^!f[state(S)] <- .print("  f ", S).
^!cl[state(S)] <- .print("cl ", S).
^!deep[state(S)] <- .print("   deep ", S).
^!p[state(waiting)[reason(R)]] <- .print("p waits ", R).
+!outer <- !inner; .print("outer body").
+!inner <- .wait(10); .print("inner body").
+!f <- { .wait(5) } |&| { .wait(10) }; .print("f joined").
+!cl <- !mid. +!mid <- !deep. +!deep <- .fail(x). -!cl <- .print("cl handler").
+!p <- .wait(20).
+!start <- !outer; .wait(50); .print("--"); !f; .wait(50); .print("--"); !cl; .wait(50); .print("--"); !!p; .wait(5); .suspend(p); .wait(50); .resume(p); .wait(50); .stopMAS.
