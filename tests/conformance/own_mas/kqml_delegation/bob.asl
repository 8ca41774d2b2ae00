// Plans for messages may veto, unwrap and hand on to the built-in ones; one that fails is told as a communication error.
// Expected from the specification, not recorded from Jason.
// order: per-agent
secret(1). v(7). half(X) :- v(Y) & X = Y / 2.
+!kqml_received(_, tell, bad(X), _) <- .print("veto ", X).
+!kqml_received(S, tell, wrapped(C), M) <- .print("unwrap ", C); !kqml_received(S, tell, C, M); .print("unwrapped").
+!kqml_received(S, askOne, secret(_), M) <- .print("hidden"); .send(S, tell, refused, M).
+!kqml_received(_, propose, _, _)[source(Q)] <- .print("not here ", Q).
+!kqml_received(_, propose, X, _) <- .print("proposed ", X); .fail(error_msg("no deal"), reason(x)).
+!kqml_received(S, order, X, M) <- .print("ordered ", X); !kqml_received(S, achieve, X, M); .print("handed on").
+ok(X)[source(S)] <- .print("ok ", X, " ", S).
+!clean(X)[source(S)] <- .print("clean ", X, " ", S).
