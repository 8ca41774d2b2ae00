!start.
+!start <- .nth(9, [a,b], X).
