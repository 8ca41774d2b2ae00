// Rules 17, 18 and 37: strings and quoted atoms in annotations.
b("x y")[note("a b"), 'q r']. 
!s. +!s <- ?b(S)[note(N)]; .print(S, N); ?b(X)[source(self)|R]; .print(R); .concat(S, "-", N, C); .print(C); .print(b(S)[note(N)]).
