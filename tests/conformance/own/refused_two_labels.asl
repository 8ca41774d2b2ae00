// A plan has one label.
b(1).
@a @b +!s <- a.
