// Goal patterns: blind commitment tries again until the goal is believed.
n(0).
{ begin bc(clean) }
+!clean : n(X) & X < 3 <- .print(try, X); -+n(X + 1).
+!clean : n(3) <- -+n(4); .fail.
+!clean : n(4) <- .print(now); +clean.
{ end }
!s.
+!s <- !clean; .print(done).
