// Rule 55: rules are added with the values of their variables; +> puts them last.
!s. +!s <- K = 3; +{ gt(X) :- X > K }; if (gt(4) & not gt(2)) { .print(ok) }; .relevant_rules(gt(_), L); .length(L, N); .print(N); .abolish(gt(_)); +>{ gt(X) :- X = 100 }; .findall(Q, .member(Q,[1,50,100]) & gt(Q), M); .print(M).
