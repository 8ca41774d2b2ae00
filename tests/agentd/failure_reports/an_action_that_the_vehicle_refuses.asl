!start.
+!start <- takeoff(5).
