// Rules 57 and 63: | in contexts, the first solution, variables that stay free.
p(1). p(2). q(2).
edge(a,b). edge(b,c). edge(a,d). edge(d,e). good(e).
reach(X,Y,[X,Y]) :- edge(X,Y).
reach(X,Y,[X|P]) :- edge(X,Z) & reach(Z,Y,P).
!s.
+!s : reach(a,T,P) & good(T) <- .print(T, P); !g(1); !g(2); !g(3).
+!g(X) : p(X) & q(X) | X = 3 & Y = three <- .print(X, Y).
+!g(X) : (p(X) & not q(X)) | false <- .print(only, X).
