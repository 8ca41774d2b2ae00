position(1,2).
!start.
+!start <- ?position(P).
