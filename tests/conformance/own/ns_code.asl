// Rule 101: code in braces inside a namespace block belongs to the namespace too.
{ begin namespace(n) }
c(1).
+!go <-
    .wait({ +tick(X) }); .print(X);
    B = { +seen(1); !sub(2) }; B; ?seen(Y); .print(Y);
    +{ +!late(Q) <- .print("late ", Q) }; !late(3);
    +{ r(Z) :- c(Z) }; ?r(W); .print(W);
    .add_plan({ +!later <- .print("later ", f(c)) }); !later;
    (+done; ?done); .print(end).
+!sub(X) <- .print("n sub ", X).
{ end }
!s. !t.
+!s <- !n::go; if (n::done & not done & not seen(_)) { .print(apart) }.
+!t <- .wait(10); +tick(7); .wait(10); +n::tick(8).
+!sub(X) <- .print(never).
