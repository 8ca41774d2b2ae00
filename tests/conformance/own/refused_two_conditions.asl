// A goal has one condition.
b(1).
+!s <: a <: b <- c.
