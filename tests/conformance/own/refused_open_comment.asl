// A comment is not closed.
b(1).
/* open
c.
