// D1: a formula on a new line after an action needs no semicolon.
!s.
+!s <-
  .print(a)
  .print(b)
  f(1)
  .print(never).
-!s[error(E)] <- .print(E).
