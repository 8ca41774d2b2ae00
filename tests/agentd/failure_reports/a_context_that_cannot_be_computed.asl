!start.
+!start : X = 1 div 0.
