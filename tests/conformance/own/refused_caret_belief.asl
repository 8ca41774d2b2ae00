// There are no meta events of beliefs.
b(1).
^b <- a.
