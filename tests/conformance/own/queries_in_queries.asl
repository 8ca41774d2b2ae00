// Queries inside queries keep their variables apart.
p(1). p(2). q(X,Y) :- p(X) & p(Y).
!s. +!s <- .findall(X-L, p(X) & .findall(Y, q(X,Y), L), R); .length(R,N); .print(N); .findall([X,L], p(X) & .findall(Y, q(X,Y), L), R2); .print(R2); .setof(Y, q(_,Y), S); .print(S); .count(q(_,_), C); .print(C); .max(X3, p(X3), M); .print(M).
