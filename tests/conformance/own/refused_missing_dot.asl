// Two beliefs without a dot between them.
b(1).
c(1)
d(2).
