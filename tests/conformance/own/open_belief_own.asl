// Rule 53: the belief does not share its variable with the plan that added it.
!s.
+!s <-
    +p(X, f(X)); X = 3; if (p(4, f(4))) { .print("p(4,f(4))") };
    +q(Y); !see; .print(end).
+!see <- ?q(1); .print(one); !again.
+!again <- ?q(2); .print(two); ?p(a, F); .print(F).
