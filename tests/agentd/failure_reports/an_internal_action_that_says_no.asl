!start.
+!start <- .member(3, [1,2]).
