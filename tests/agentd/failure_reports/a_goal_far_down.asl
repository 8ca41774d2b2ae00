!a.
+!a <- !b; .print(a).
+!b <- !c; .print(b).
+!c <- !d(1,"x",[1,2,3]); .print(c).
+!d(X,Y,Z) <- false.
