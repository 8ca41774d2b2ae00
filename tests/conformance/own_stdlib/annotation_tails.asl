// The tail of annotations in literals, triggers and text that is read takes what is left over, and prints as a tail.
// Expected from the specification, not recorded from Jason.
!start.
+!raise(X) <- .wait(20); .signal({ +ev(X)[b,a] }).
+!start
   <- L = p(X)[a|A]; .print(L); L = p(1)[c,a]; .print(X, " ", A);
      !!raise(1); .wait({ +ev(Y)[a|B] }); .print(Y, " ", B);
      !!raise(2); .wait({ +ev(_)[S|_] }); .print(S);
      P = { +ev(Z)[|C] }; P = { +ev(3)[n,m] }; .print(Z, " ", C);
      .term2string(T, "q(1)[b|W]"); .print(T); +T; ?q(_)[|V]; .print(V).
