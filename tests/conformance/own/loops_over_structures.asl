// Rule 76: a variable inside a structure that a loop or a deletion asks with is free again in each round and afterwards.
p(f(1,1)). p(f(2,2)). p(f(3,1)). q(f(1)). q(f(2)). n(0). d(f(1,1)). d(f(3,2)).
r([X,Y]) :- .member(X,[1,2]) & Y = X*2.
!s.
+!s <- !facts; !results; !members; !rules; !rounds; !deleted.
+!facts <- F = f(A,1); for (p(F)) { .print(A) }; A = z; .print(F).
+!results <- F = f(A); for (q(F)) { .print(A); !set(B,F); .print(B) }; A = z; B = b; .print(F, " ", B).
+!members <- F = f(A); for (.member(X,[1,2])) { !put(F,X); .print(F) }; A = z; .print(F).
+!rules <- L = [A|T]; for (r(L)) { .print(A, " ", T) }; A = z; .print(L).
+!rounds <- F = f(A); while (n(I) & I < 2 & F = f(I)) { .print(A); -+n(I+1) }; A = z; .print(F).
+!deleted <- -d(f(X,2)); .print(X); ?d(Y); .print(Y).
+!set(B,F) <- B = F.
+!put(f(X),X).
