// Relations are written <= and >=.
b(1).
+!s <- X =< 2.
