// A goal that runs with a free argument is intended for any value asked; the asker's variable stays free.
// D7: Jason printed the same but for `W free`: there a variable of the goal stays bound by the first question of a plan.
!start.
+!find(X) <- .wait(200); X = 5.
+!pair(X, X) <- .wait(200).
+!caller <- !find(Y); .print("found ", Y).
+!start
   <- !!caller; !!pair(A, B); .wait(50);
      if (.intend(find(3))) { .print("find 3 is intended") };
      .findall(x, .intend(find(Z)), L); .length(L, N); .print(N);
      if (.intend(find(W)) & not .ground(W)) { .print("W free") };
      if (.intend(pair(1, 1))) { .print("pair 1 1") }; if (not .intend(pair(1, 2))) { .print("not pair 1 2") };
      .wait(300); .stopMAS.
