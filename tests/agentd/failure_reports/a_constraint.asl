!start.
+!start <- !check(1).
+!check(X) <-
   .print("checking"); X > 3.
