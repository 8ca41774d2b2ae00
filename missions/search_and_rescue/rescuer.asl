/* A rescuer of a search and rescue (the paper, section 5.2). It hears of victims from the scout, negotiates with the
   other rescuers who goes, flies to its victim, drops a buoy, returns and takes a new one, and goes on while its battery
   lasts.

   What to do next follows from what it believes now, and never from where in a plan it was. So it may be killed at any
   moment: started again it looks at itself and goes on. Above all it looks at the latch that holds the buoy: whatever
   became of the action that opens it and of those who asked for it, open means dropped, and closed means not. */

{ include("flying.asl") }

oriented :- perceiving & latch(_) & home_pos(_, _).     // after a cold start home is known last
aboard :- latch(Pulse) & Pulse < 1500.                  // microseconds of the servo; 0 before it has moved at all
gone :- latch(Pulse) & Pulse >= 1500.
at_home :- home_pos(Lat, Lon) & global_pos(MyLat, MyLon) & metres(MyLat, MyLon, Lat, Lon, Off) & Off < 5.

/* Percent of the battery: below battery_low(P) of the mission it turns back, and 20 more are enough to go out. Nobody
   need charge it between two flights. A vehicle that does not know what is left tells -1. */
turn_back_at(P) :- battery_low(P).
turn_back_at(40) :- not battery_low(_).
go_out_at(P) :- turn_back_at(Low) & P = math.min(Low + 20, 95).
spent :- battery(_, _, Left) & Left >= 0 & turn_back_at(P) & Left < P.
ready :- battery(_, _, Left) & (Left < 0 | go_out_at(P) & Left >= P).

free :- not mine(_) & aboard & ready & not armed.
taken(V) :- held(V, R) & not .my_name(R).
promised(V) :- held(V, R) & .my_name(R) & not rescued(V).
open(V, Lat, Lon) :- victim(V, Lat, Lon) & not rescued(V) & not taken(V).
idle :- not promised(_) & not open(_, _, _).
done_with_all :- idle & search_over & not resting.

// What it would take to rescue V: the way, longer with an emptier battery. Equal bids are told apart by the name.
bid(V, offer(Cost, Me))
  :- free & open(V, Lat, Lon) & global_pos(MyLat, MyLon) & metres(MyLat, MyLon, Lat, Lon, Way) & battery(_, _, Left)
     & Cost = Way * (2 - Left / 100) & .my_name(Me).

!serve.

// What the bridge began for an earlier life ends within its deadline of 10 s: the latch moves no more then.
+restarted(_) <- .print("here again"); .wait(10000); !serve.
+interrupted(Action, State, Why) <- .print(Action, " went on without me: ", State, " ", Why).

+!serve <- !step; !!serve.
-!serve[error_msg(Why)] <- .print("again, for ", Why); .wait(3000); !!serve.

+!step : not oriented <- .wait(oriented, 60000, _).
+!step : mine(V) & gone <- !report(V).
+!step : mine(V) & spent <- !give_back(V).
+!step : mine(V) <- !rescue(V).
+!step : armed <- !homeward.
+!step : not at_home <- !be_carried.
+!step : gone <- .print("a new buoy"); load_buoy; .wait(aboard, 10000).
+!step : done_with_all <- +resting.
+!step : idle <- .wait(not idle | done_with_all, 60000, _).
+!step : not ready & battery(_, _, Left) & go_out_at(P)
  <- .print("my battery has ", Left, " %, and I go out from ", P, " % on");
     .wait(ready, 600000, _).
+!step : promised(V) <- .print("I am to go for ", V); +mine(V).       // the answer to a claim was lost
+!step <- -resting; !negotiate.

// It stands somewhere else: landed by its pilot, or by a failsafe.
+!be_carried <- .print("I wait to be carried home"); .wait(at_home, 60000, _).

/* Who goes: the nearest victim first, of those that nobody else is better placed for. The others answer by their own
   rule bid, or not at all when they are busy, dead or cut off. */

+!negotiate
  <- .findall(bid(Offer, V), bid(V, Offer), Bids);
     .sort(Bids, Sorted);
     !try(Sorted).

+!try([]) <- .wait(3000).
+!try([bid(Mine, V) | Others]) : peers(Peers)
  <- .send(Peers, askOne, bid(V, _), Answers, 10000);
     .findall(Offer, .member(bid(V, Offer), Answers), Offers);
     if (.min([Mine | Offers], Mine)) { !claim(V) } else { !try(Others) }.

+!claim(V) : scout(Scout)
  <- .send(Scout, askOne, claim(V, _), Answer, 10000);
     if (claim(V, yes) = Answer) { .print("I go for ", V); +mine(V) } else { .wait(1000) }.

/* The rescue. Dropping needs the scout's leave, asked for above the victim; without an answer it is asked for again. */

+!rescue(V) : victim(V, Lat, Lon) & height(H) & scout(Scout)
  <- !at(Lat, Lon, H);
     .send(Scout, askOne, may_drop(V, _), Answer, 15000);
     !drop(V, Answer).

+!drop(V, may_drop(V, yes)) : over(V) <- drop_buoy; .wait(gone, 10000).
+!drop(V, may_drop(V, no)) <- .print(V, " is another's now"); -mine(V).
+!drop(_, _).

over(V) :- victim(V, Lat, Lon) & global_pos(MyLat, MyLon) & metres(MyLat, MyLon, Lat, Lon, Off) & Off < 3.

+!report(V) : scout(Scout) & peers(Peers)
  <- .print("buoy dropped for ", V);
     .send([Scout | Peers], tell, rescued(V));
     +rescued(V);
     -mine(V).

+!give_back(V) : scout(Scout)
  <- .print("too little battery for ", V);
     .send(Scout, achieve, give_back(V));
     -mine(V).

// It was away for too long, and its victim was promised to another: it turns back.
+held(V, R) : mine(V) & not .my_name(R) <- .print(R, " goes for ", V); -mine(V); .fail_goal(rescue(V)).
