// Rules 9 and 10: a sign binds tighter than **, also behind **.
!s.
+!s <-
    .print(-2**2, " ", -(2**2), " ", 2-2**2, " ", 2**-2**2, " ", - 2 ** 2);
    A = 3; .print(-A**2, " ", 1-A**2, " ", -A*2, " ", 2*-A**2);
    .print(10 - 2 - 3 + 1, " ", 2 * 3 mod 4 * 2, " ", 7 div 2 * 2, " ", 100 / 10 div 3).
