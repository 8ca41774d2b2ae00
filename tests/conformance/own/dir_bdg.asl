// Rule 104: the retry of bdg counts as already intended and ends without success.
{ begin bdg(at(3)) }
+!at(X) : easy <- .print(going); +at(X).
+!at(X) <- .print("not getting there").
{ end }
!s.
+!s <- !at(3); .print(after); +easy; !at(3); if (at(3)) { .print("at 3") }.
