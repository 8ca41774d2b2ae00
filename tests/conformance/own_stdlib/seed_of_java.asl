// The numbers after .set_random_seed are those that the documentation of java.util.Random tells for the seed.
// Expected from that, not recorded from Jason.
!start.
+!start
   <- .set_random_seed(42); .random(A); .random(B); .print(A, " ", B);
      .set_random_seed(42); .findall(X, .range(_, 1, 5) & .random([0,1,2,3,4,5,6,7,8,9], X), L); .print(L);
      .set_random_seed(-1); C = math.random(100); .print(C); .stopMAS.
