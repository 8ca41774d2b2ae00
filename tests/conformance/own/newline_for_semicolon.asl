// D1: a formula on a new line needs no semicolon where it can only begin there.
!s.
+!s <-
  .print(a)
  !twice(2)
  +seen(1)
  -+seen(2)
  ?seen(X)
  -seen(X)
  Y = X + 1
  +counted
  .print(b, Y)
  f(1)
  .print(never).
+!twice(N) <-
  ?half(N, H)
  .print(H).
half(N, H) :- H = N / 2.
-!s[error(E)] <- .print(E).
