// Rule 110: for is reserved.
b(1).
for(2).
