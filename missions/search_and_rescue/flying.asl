/* What scout and rescuers alike know of flying.

   Nothing is tried again here: a step that fails ends, and the program decides anew by what it perceives. */

armed :- state(_, _, true).
aloft :- armed & altitude(A) & A > 2.

/* What a pilot, a ground station or its own failsafe has taken is theirs until a person sets GUIDED: in the air, while it is
   silent, and on the ground, where people may stand beside it. */
theirs(Mode) :- others_have(Mode) & not state("GUIDED", true, _).
+override(Mode) <- +others_have(Mode).
-bridge(up) : out <- +unseen.                           // nobody tells of an override now
+state("GUIDED", true, _) : others_have(_) <- .abolish(others_have(_)).

// All that decisions are made by is perceived: after a start, and whenever the bridge was away.
perceiving :- bridge(up) & state(_, true, _) & altitude(_) & global_pos(_, _) & battery(_, _, _).

metres_per_degree(111320).
metres(Lat1, Lon1, Lat2, Lon2, D)
  :- metres_per_degree(M) & North = (Lat2 - Lat1) * M & East = (Lon2 - Lon1) * M * math.cos(Lat1 * math.pi / 180)
     & D = math.sqrt(North ** 2 + East ** 2).

+!at(Lat, Lon, Height) <- !aloft(Height); goto(Lat, Lon, Height).

+!aloft(_) : aloft & state("GUIDED", _, _).
+!aloft(_) : aloft <- +out; set_mode("GUIDED").         // on its way home, or held by the bridge
+!aloft(Height) <- set_mode("GUIDED"); !armed; takeoff(Height).

// Before all other steps. What was out when the bridge was lost and has landed meanwhile, others have landed.
+!step : unseen & perceiving & state(Mode, _, false) & Mode \== "GUIDED" <- -unseen; +others_have(Mode).
+!step : unseen & perceiving <- -unseen.

// What a pilot, a ground station or its own failsafe has taken is left to them.
+!step : theirs(Mode) <- .print("left to those who have it, in ", Mode); .wait(not theirs(_), 900000, _).
+!step : override(_) <- set_mode("GUIDED").

+!armed : armed.
+!armed <- +out; arm_motors(true).

+!homeward <- -out; return_to_launch.
