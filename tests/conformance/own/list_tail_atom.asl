// D3: a list with a tail that is no list prints as [a|b].
!s.
+!s <- T = b; L = [a|T]; .print(L, " ", f(L)).
