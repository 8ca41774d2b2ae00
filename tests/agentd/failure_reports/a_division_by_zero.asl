!start.
+!start <- X = 10 div 0; .print(X).
