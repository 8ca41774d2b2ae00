!start.
+!start <- !goto(1,2).
+!goto(X).
