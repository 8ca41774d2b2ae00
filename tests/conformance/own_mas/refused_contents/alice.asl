// What is no belief, goal, event or label is refused. (the part of alice)
// order: per-agent
!go.
+!go
   <- .send(bob, tell, 3); .send(bob, tell, "text"); .send(bob, tell, { p :- q }); .wait(50);
      .send(bob, tell, [a(1), 3, "text", ~a(2), [a(9)], X]); .wait(50);
      .send(bob, untell, [a(1)]); .wait(50);
      .send(bob, achieve, [g(1), 4, g(2)]); .send(bob, achieve, 4); .wait(50);
      .send(bob, signal, s(1)); .send(bob, signal, [s(2)]); .wait(50);
      .send(bob, unachieve, 5); .send(bob, untellHow, 6); .send(bob, tellHow, "no plan"); .send(bob, askHow, b(_)); .wait(50);
      .send(bob, gossip, b(1)); .wait(50); .print("nothing noticed"); .stopMAS.
