// Goal patterns: ebdg tries each plan once until one achieves the goal.
{ begin ebdg(clean) }
+!clean : wet <- .print(never).
+!clean <- .print(first).
+!clean <- .print(second); .fail.
+!clean <- .print(third); +clean.
+!clean <- .print(never).
{ end }
!s.
+!s <- !clean; .print(done); -clean; !clean; .print(again).
