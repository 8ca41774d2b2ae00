position(1,2). position(3,4).
!start.
+!start <- ?position(7,Y).
