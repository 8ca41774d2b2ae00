// A rule needs a head.
b(1).
X :- b.
