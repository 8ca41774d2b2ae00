battery(80).
!start.
+!start <- ?batery(B).
