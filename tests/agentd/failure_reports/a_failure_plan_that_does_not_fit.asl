!start.
+!start <- !fly.
+!fly <- ?height(H).
-!fly[reason(R)] <- .print(R).
-!fly : battery(B) <- .print(B).
