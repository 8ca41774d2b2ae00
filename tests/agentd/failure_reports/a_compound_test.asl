battery(80).
!start.
+!start <- ?(battery(B) & B > 90).
