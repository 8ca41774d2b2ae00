/* The scout of a search and rescue (the paper, section 5.2). It sweeps its area in lanes, tells the rescuers of each
   victim once, and keeps the book of who is to rescue whom.

   Rescuers negotiate among themselves who goes. The book makes sure that two never bring a buoy to the same victim,
   also when one of them is cut off on its way: a rescuer drops only with leave that was given over the victim, and a
   victim whose rescuer has that leave is nobody else's until that rescuer tells what became of it. Before that it may
   be promised to another one at any time. So nobody has to agree about the time. */

{ include("flying.asl") }

next_lane(0).

lanes(N) :- area(South, _, North, _) & lane_width(W) & metres_per_degree(M) & N = math.ceil((North - South) * M / W).

lane(K, Lat, West, East) :- K mod 2 == 0 & area(_, West, _, East) & lane_at(K, Lat).
lane(K, Lat, East, West) :- K mod 2 == 1 & area(_, West, _, East) & lane_at(K, Lat).
lane_at(K, Lat) :- area(South, _, _, _) & lane_width(W) & metres_per_degree(M) & Lat = South + (K + 0.5) * W / M.

swept :- next_lane(K) & lanes(N) & K >= N.
missing(V) :- found(V, _, _) & not rescued(V).
open(V) :- missing(V) & not held(V, _).

/* The search: one step after the other, each chosen by what is believed now. So nothing has to be remembered of where
   a plan was when a step fails, or when this daemon is started again. */

!search.
+restarted(_) <- for (held(V, R)) { !!lease(V, R) }; !search.

+!search <- !step; !!search.
-!search[error_msg(Why)] <- .print("again, for ", Why); .wait(3000); !!search.

+!step : not perceiving <- .wait(perceiving, 60000, _).
+!step : not swept & next_lane(K) <- !lane(K); -+next_lane(K + 1).
+!step : armed <- .print("swept"); !homeward.
+!step : not search_over & rescuers(All) <- +search_over; .send(All, tell, search_over).
+!step : missing(_) <- .wait(not missing(_), 60000, _).
+!step : not mission_done <- .print("all are rescued"); +mission_done.
+!step <- .wait(missing(_), 60000, _).

+!lane(K) : lane(K, Lat, From, To) & height(H) <- .print("lane ", K); !at(Lat, From, H); goto(Lat, To, H).

@told_once[atomic]
+victim(V, Lat, Lon) : not found(V, _, _) & rescuers(All)
  <- +found(V, Lat, Lon);
     .print("victim ", V, " at ", Lat, ", ", Lon);
     .send(All, tell, victim(V, Lat, Lon)).

/* The book: held(V, R), the victim V is promised to the rescuer R; cleared(V, R), R has leave to drop its buoy there.
   Both questions may come again, after an answer that was lost or a restart, and then get the same answer. */

@claimed_before[atomic] +?claim(V, yes)[source(R)] : held(V, R).
@claimed[atomic]        +?claim(V, yes)[source(R)] : open(V) & not cleared(_, R) <- !promise(V, R).
+?claim(_, no).

@cleared_before[atomic] +?may_drop(V, yes)[source(R)] : cleared(V, R).
@may_drop[atomic]       +?may_drop(V, yes)[source(R)] : held(V, R) <- +cleared(V, R).
@may_after_all[atomic]  +?may_drop(V, yes)[source(R)] : open(V) & not cleared(_, R) <- !promise(V, R); +cleared(V, R).
+?may_drop(_, no).

// Who asks for a victim has no other one any more: it may not have heard that it got it.
+!promise(V, R) : rescuers(All)
  <- for (held(Other, R)) { !take_back(Other, R) };
     +held(V, R);
     .send(All, tell, held(V, R));
     !!lease(V, R).

+!take_back(V, R) : rescuers(All) <- -cleared(V, R); -held(V, R); .send(All, untell, held(V, R)).

+rescued(V)[source(R)] <- .print(R, " has rescued ", V); .abolish(cleared(V, _)); .abolish(held(V, _)).

@given_back[atomic] +!give_back(V)[source(R)] : held(V, R) <- .print(R, " gives ", V, " back"); !take_back(V, R).
+!give_back(_).

/* A victim is stranded by nobody: a promise ends with its time, or when the rescuer is away for too long. */

+!lease(V, R) : lease(S) <- .wait(not held(V, R), S * 1000, _); !expire(V, R).

-online(R) : held(V, R) & patience(S) <- .wait(online(R), S * 1000, _); if (not online(R)) { !expire(V, R) }.

@expired[atomic]
+!expire(V, R) : held(V, R) & not cleared(V, R) <- .print(V, " is free again: ", R, " is late"); !take_back(V, R).
+!expire(V, R) : cleared(V, R) & lost(S) <- .wait(not held(V, R), S * 1000, _); !write_off(V, R).
+!expire(_, _).

// Whether it dropped its buoy nobody will ever know: two buoys are better than none.
@written_off[atomic]
+!write_off(V, R) : held(V, R) <- .print(R, " is lost, and ", V, " is free again"); !take_back(V, R).
+!write_off(_, _).
