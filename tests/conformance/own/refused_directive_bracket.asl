// A directive is not closed.
b(1).
{ include("a.asl" }
c.
