// Rule 109: what suspends cannot stand in a rule.
b(1).
r(X) :- .suspend.
