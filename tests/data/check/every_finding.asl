/* Every finding of `agentd check` that can stand in a program; tests/agentd/check/test_every_finding.py says where each is told.

       agentd check --manifest copter tests/data/check/every_finding.asl

   Without the manifest other findings come in place of those against it. incomplete.asl holds the two that hide others. */

!start.
!climb.                                            // goal-without-plan

waypoint(1, 47.1).
include("navigation.asl").                         // directive-as-belief
{ inculde("navigation.asl") }                      // unknown-directive
{ begin namspace(team) } +!meet. { end }           // unknown-directive, plan-never-used
{ register_function("area.of") }                   // unknown-directive

reachable(X) :- waypoint(X, Y) & near(X).          // singleton-variable, belief-never-added
far(P) :- waypoint(P, D) & L > D & L < 9.          // unbound-variable

@main +!start : waypont(N, _) & state(_, _)        // belief-never-added, percept-arity
  <- .pritn(N);                                    // unknown-internal-action
     .wait;                                        // internal-action-arity
     X = math.sqr(4);                              // unknown-function
     take_off(X);                                  // unknown-action
     takeoff(X, 5);                                // action-arity
     takeoff(500);                                 // action-type
     arm_motors("yes");                            // action-type
     print("up");                                  // unknown-action; undotted-internal-action without a manifest
     .send(base, askOne, wind(_), W);
     .send(base, tel, wind(W));                    // unknown-performative
     not far(N);                                   // formula-as-action
     land
     !wait_for_wind;                               // missing-semicolon
     !patrol.

@main +!wait_for_wind                              // duplicate-label
  <- while (true) { -+waiting(yes) }.              // busy-loop

+!wait_for_wind : far(_) <- land.                  // plan-shadowed

+!patrol <- .print("round"); !patrol.              // busy-loop

@ask[atomic] -!start
  <- .send(self, askAll, far(_), L); .print(L).    // endless-ask

@never[atomci] +!never <- land.                    // plan-never-used, misspelt-annotation

-!strat <- land.                                   // plan-never-used

+global_pos(Lat, Lon, Height)                      // percept-arity
  <- .print(Lat, Lon, Height).

+batery(_, Volts, _) : Volts < 14 <- land.         // unknown-percept
