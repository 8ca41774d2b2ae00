// (m) 10000 beliefs, then idle: how much memory they take
!start.
+!start <- !fill(10000); .print("FIRST"); .wait(600000).
+!fill(N) : N > 0 <- +fact(N,N*2); !fill(N-1).
+!fill(0).
