!start.
+!start <- !Goal.
