/* What scout and rescuers alike know of flying.

   Nothing is tried again here: a step that fails ends, and the program decides anew by what it perceives. */

armed :- state(_, _, true).
aloft :- armed & altitude(A) & A > 2.

/* Another's: a pilot's, until he hands it over by GUIDED; its failsafe's, until it stands on the ground. A silent vehicle
   is still whose it was, and one that was landed elsewhere than by RTL waits for a person who sets GUIDED. */
theirs(Mode) :- override(Mode) & not state("GUIDED", true, _) & not state(_, true, false).
theirs(Mode) :- flown & state(Mode, true, _) & not .member(Mode, ["GUIDED", "RTL", "BRAKE", "STABILIZE"]).

// All that decisions are made by is perceived: after a start, and whenever the bridge was away.
perceiving :- bridge(up) & state(_, true, _) & altitude(_) & global_pos(_, _) & battery(_, _, _).

metres_per_degree(111320).
metres(Lat1, Lon1, Lat2, Lon2, D)
  :- metres_per_degree(M) & North = (Lat2 - Lat1) * M & East = (Lon2 - Lon1) * M * math.cos(Lat1 * math.pi / 180)
     & D = math.sqrt(North ** 2 + East ** 2).

+!at(Lat, Lon, Height) <- !aloft(Height); goto(Lat, Lon, Height).

+!aloft(_) : aloft & state("GUIDED", _, _).
+!aloft(_) : aloft <- set_mode("GUIDED").               // on its way home, or held by the bridge
+!aloft(Height) <- set_mode("GUIDED"); !armed; takeoff(Height).

// Before all other steps: what a pilot, a ground station or its own failsafe has taken is left to them.
+!step : theirs(Mode) <- .print("left to those who have it, in ", Mode); .wait(not theirs(_), 900000, _).
+!step : override(_) <- set_mode("GUIDED").

+!armed : armed.
+!armed <- +flown; arm_motors(true).
