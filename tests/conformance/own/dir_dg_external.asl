// Rule 104: a declarative goal is achieved as soon as it is believed, wherever its plan is.
{ begin dg(at(3)) }
+!at(X) : slow <- .print(slow); .wait(1000); .print(never).
+!at(4) <- .print("not of the pattern").
+!at(X) <- .print(going); +at(X); .print(never).
{ end }
slow.
!s. !t.
+!s <- !at(3); .print("at 3"); -slow; -at(3); !at(3); .print("again"); !at(4); .print(end).
+!t <- .wait(50); +at(3).
