// Goal patterns: when no plan of ebdg is left the goal fails.
{ begin ebdg(clean) }
+!clean <- .print(first).
+!clean <- .print(second).
{ end }
!s.
+!s <- !clean; .print(never).
-!s <- .print("not clean").
