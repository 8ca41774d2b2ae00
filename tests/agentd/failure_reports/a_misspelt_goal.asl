!start.
+!start <- !gto(3).
+!goto(X).
