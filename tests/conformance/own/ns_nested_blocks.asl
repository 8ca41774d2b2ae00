// Rule 101: blocks in one another, and the names of other namespaces inside them.
{ begin namespace(a) }
b(1).
{ begin namespace(c) }
b(2).
+!g <- ?b(X); .print(X); ?a::b(Y); .print(Y); ?default::b(Z); .print(Z).
{ end }
+!g <- ?b(X); .print(a, X).
{ end }
b(3).
!s.
+!s <- !c::g; !a::g.
