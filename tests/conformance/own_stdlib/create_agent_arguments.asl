// What .create_agent, .clone and .kill_agent take; Java classes are named as what cannot be, the plain ones are what agents are.
// Expected from the specification, not recorded from Jason.
!start.
+!start
   <- .create_agent(kid); .create_agent("kid"); .create_agent(Free); .print(Free); .clone("kid");
      .all_names(L); .sort(L, S); .print(S);
      .create_agent(plain, "", [agentArchClass("jason.architecture.AgArch"), beliefBaseClass(jason.bb.DefaultBeliefBase)]);
      .all_names(L2); .length(L2, N); .print(N);
      for (.range(I, 1, 9)) { !t(I) };
      .kill_agent(kid); .kill_agent("kid_1", 50); .wait(100); .all_names(L3); .length(L3, N3); .print(N3).
+!t(1) <- .create_agent(a, b).
+!t(2) <- .create_agent(a, "x.asl", opts).
+!t(3) <- .create_agent(a, "missing.asl").
+!t(4) <- .create_agent(a, "", [agentArchClass("my.Arch")]).
+!t(5) <- .create_agent(3).
+!t(6) <- .clone(kid).
+!t(7) <- .kill_agent(nobody).
+!t(8) <- .kill_agent(kid, soon).
+!t(9) <- .create_agent.
-!t(N)[error(E)] <- .print(N, " ", E).
