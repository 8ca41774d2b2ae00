// Plans for messages may veto, unwrap and hand on to the built-in ones. (the part of alice)
// order: per-agent
!go.
+!go <- .send(bob, tell, bad(1)); .send(bob, tell, ok(1)); .wait(50); .send(bob, tell, wrapped(ok(2))); .wait(50);
  .send(bob, askOne, secret(_), A); .print(A);
  .send(bob, askOne, half(_), H); .print(H);
  .send(bob, askAll, v(_), L); .print(L);
  .send(bob, propose, deal); .wait(50); .send(bob, order, clean(1)); .wait(50); .stopMAS.
