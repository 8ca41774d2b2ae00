// Rule 88: the annotations of the goal are on its failure event.
!s.
+!s <- !g(1)[prio(5), src(a)]; !g(2)[prio(1)].
+!g(X)[prio(P)] <- .fail.
-!g(X)[prio(P), src(S)] : P > 3 <- .print("high ", X, P, S).
-!g(X)[prio(P)|R] <- .member(error(E), R); .print("low ", X, P, E).
