{ include("../suite/tester.asl") }

double(X, Y) :- Y = 2 * X.

+!setup <- -+count(0).
+!teardown <- ?count(N); !assert_between(N, 0, 1).

@adds[test] +!adds <- X = 1 + 2; !assert_equals(3, X).
@[test]     +!doubles : double(4, Y) <- !assert_equals(8, Y); !assert_equals(2.67, Y / 3, 0.01).
@slow[test, seconds(1)] +!waits <- .wait(20); ?double(1, Z); -+count(1); !assert_true(count(1)); !assert_false(Z > 2).
+!no_test_of_mine <- .fail.
