// Rules 63 and 73: plans whose trigger is a variable, in file order, with annotations.
!s.
+!a(X) <- .print(a, X).
+!G[urgent(X)] <- .print("urgent ", G, " ", X).
+!G <- .print("any goal ", G).
+B <- .print("any belief ", B).
-B <- .print("gone ", B).
+?T <- .print("any test ", T).
+!z <- .print(never).
@first +!s : true <- .print(never).
