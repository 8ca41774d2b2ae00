// .replace and .delete read Java's regular expressions and replacement texts; a bad one fails, in a condition it is false.
// Expected from the specification, not recorded from Jason.
!start.
+!start <- for (.range(I, 1, 11)) { !t(I) }.
+!t(1) <- .replace("abc", "(b)(c)", "<$2$1$0>", R); .print(R).
+!t(2) <- .replace("2026-11-21", "(?<y>[0-9]+)-([0-9]+)", "$2/${y}", R); .print(R).
+!t(3) <- .replace("aaa", "a*", "b", R); .print(R).
+!t(4) <- .replace("abc", "b", "$10", R); .print("not here").
+!t(5) <- .replace("abc", "(b)", "$10", R); .print(R).
+!t(6) <- .replace("abc", "(", "x", R); .print("not here").
+!t(7) <- .delete("(", "a(b", R); .print("not here").
+!t(8) <- if (.replace("abc", "(", "x", R) | .delete("[", "a", R)) { .print("not here") } else { .print("false") }.
+!t(9) <- .replace(p(x,"x"), "x", "y", R); .print([R]).
+!t(10) <- .replace("abc", b, "x", R); .print("not here").
+!t(11) <- .replace("price", "price", "5$", R); .print("not here").
-!t(N)[error(E)] <- .print(N, " ", E).
