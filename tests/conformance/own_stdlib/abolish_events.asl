// The deletion event of .abolish has no annotations: a plan that asks for the source does not see it, one that does not does.
// Expected from stdlib/abolish_by_source, not recorded from Jason.
b(1)[source(ann)]. c(2)[source(ann)].
!start.
-b(X)[source(S)] <- .print("b of ", S).
-c(X)[source(S)] <- .print("c of ", S).
-c(X) <- .print("c").
+!start <- .abolish(_[source(ann)]); .wait(20); .stopMAS.
