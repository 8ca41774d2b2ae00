// Recursive rules and goals with results.
fib(0,0). fib(1,1). fib(N,F) :- N > 1 & fib(N-1,A) & fib(N-2,B) & F = A + B.
!s. +!s <- ?fib(15,F); .print(F); !fib(10,G); .print(G).
+!fib(N,N) : N < 2. +!fib(N,F) <- !fib(N-1,A); !fib(N-2,B); F = A + B.
