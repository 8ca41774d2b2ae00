// Goal patterns: smc fails on its condition, rc drops the goal with its motive, omc does both.
{ begin smc(a, hopeless) }
+!a <- .print(a); .wait(1000).
{ end }
{ begin rc(b, motive) }
+!b <- .print(b); .wait(1000).
{ end }
{ begin omc(c, lost(_), wish) }
+!c <- .print(c); .wait(1000).
{ end }
motive. wish.
!s. !t. !u. !v.
+!s <- !a; .print(never).
-!s <- .print("a failed").
+!t <- !b; .print("b dropped").
+!u <- !c; .print("c dropped").
+!v <- .wait(50); ++hopeless; .wait(50); --motive; .wait(50); --wish; .wait(50).
