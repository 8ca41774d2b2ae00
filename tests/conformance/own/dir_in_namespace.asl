// Rules 101 and 104: a pattern in a namespace is about the goal of that namespace.
{ begin namespace(n) }
{ begin dg(at(3)) }
+!at(X) <- .print("n ", X); +at(X); .print(never).
{ end }
{ end }
!s.
+!at(X) <- .print("default ", X).
+!s <- !n::at(3); .print(done); !n::at(3); !at(3); if (n::at(3) & not at(3)) { .print(apart) }.
