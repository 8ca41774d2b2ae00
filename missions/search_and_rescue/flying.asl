/* What scout and rescuers alike know of flying.

   Nothing is tried again here: a step that fails ends, and the program decides anew by what it perceives. */

armed :- state(_, _, true).
aloft :- armed & altitude(A) & A > 2.

// All that decisions are made by is perceived: after a start, and whenever the bridge was away.
perceiving :- bridge(up) & state(_, true, _) & altitude(_) & global_pos(_, _) & battery(_, _, _).

charged :- battery(_, _, Left) & Left >= 97.

metres_per_degree(111320).
metres(Lat1, Lon1, Lat2, Lon2, D)
  :- metres_per_degree(M) & North = (Lat2 - Lat1) * M & East = (Lon2 - Lon1) * M * math.cos(Lat1 * math.pi / 180)
     & D = math.sqrt(North ** 2 + East ** 2).

+!at(Lat, Lon, Height) <- !aloft(Height); goto(Lat, Lon, Height).

+!aloft(_) : aloft & state("GUIDED", _, _).
+!aloft(_) : aloft <- set_mode("GUIDED").               // on its way home, or held by the bridge
+!aloft(Height) <- set_mode("GUIDED"); !armed; takeoff(Height).

+!armed : armed.
+!armed <- arm_motors(true).
