// A rule is asked as a fact is: annotations of an argument asked with must stand in the head of the rule.
r(f(X)) :- true. r2(f(X)[a]) :- true. r3(k[z]) :- true. r4(k).  r4(X) :- X = m.
!start.
+!start <- A = f(1)[b]; if (r(A)) {.print(r)}; if (r(f(1))) {.print(r1)}; if (r2(f(1))) {.print(r2)}; if (r2(f(1)[a])) {.print(r2a)}; if (r2(f(2)[q])) {.print(no)}; K = k; if (r3(K)) {.print(r3)}; L = k[z]; if (r3(L)) {.print(r3z)}; if (r4(L)) {.print(no)}; ?r3(M); .print(M); .findall(P, r2(P), PL); .print(PL).
