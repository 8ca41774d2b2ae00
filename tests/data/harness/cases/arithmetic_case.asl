{ include("$suite/inc/candidate.asl") }

double(X, Y) :- Y = 2 * X.

@adds[test] +!adds <- X = 1 + 2; !same(X, 3).
@[test]     +!doubles : double(4, Y) <- !same(Y, 8); !same(Y / 3, 2.67, 0.01).
@slow[test, seconds(1)] +!waits <- .wait(20); ?double(1, Z); !same(Z, 2).
+!no_test_of_mine <- .fail.
