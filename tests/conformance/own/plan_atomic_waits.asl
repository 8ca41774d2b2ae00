// Rule 72: an atomic plan keeps all others still, through sub-goals, belief plans and .wait.
!s. !t.
@a[atomic] +!s <- .print(s1); .wait(50); .print(s2); !sub(X); .print(X); +b; .print(s3).
+!sub(1) <- .print(sub).
+b <- .print(bplan).
+!t <- .print(t1); .print(t2).
