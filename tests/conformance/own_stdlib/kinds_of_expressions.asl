// Arithmetic that cannot be computed yet counts as a number, a formula as a literal and structure.
// Expected from the specification, not recorded from Jason.
!start.
+!start
   <- for (.member(T, [math.sum(5), (a & b), (1 < 2), 'Quoted a', lab::a])) {
         .findall(K, .type(T, K), L); .print(T, " ", L)
      }
      .findall(K, .type(1 + X, K), L2); .print(L2);
      if (.number(X + 1) & not .number(X) & not .literal(math.abs(x)) & not .atom(1)) { .print("tests") }
      Y = X * 2; X = 3; if (.number(Y) & Y == 6) { .print("computed ", Y) }.
