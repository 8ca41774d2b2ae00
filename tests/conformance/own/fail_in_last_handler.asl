// A failing action inside the failure plan of the first goal raises its event again (messages of stdlib.md).
n(0).
!s.
+!s <- .fail.
-!s[error(E)] : n(X) & X < 3 <- .print(X, " ", E); -+n(X + 1); ?nothing.
-!s[error(E)] <- .print("gave up ", E).
