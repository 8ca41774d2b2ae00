/* A task is a place to be visited. Whoever has it departs, visits the place, hands the task over to the next, and comes
   home. How it departs and moves is in the program that includes this one: flying.asl or driving.asl. */

!begin.

+!begin : place(Lat, Long) <- !carry(Lat, Long).
+!begin <- .print("waits for the task").

+!carry(Lat, Long)
  <- .wait(bridge(up), 120000);
     .wait(state(_, true, _), 120000);
     !departed;
     .print("on the way to ", Lat, ", ", Long);
     !visited(Lat, Long);
     !handed_over(Lat, Long);
     !home_again;
     .print("home again");
     +carried.
-!carry(Lat, Long)[error_msg(Why)]
  <- .print("cannot carry the task: ", Why);
     !handed_over(Lat, Long);
     !safe;
     +gave_up(Why).

+!handed_over(_, _) : handed.
+!handed_over(Lat, Long) : next(Agent)
  <- +handed;
     .print("hands the task over to ", Agent);
     .send(Agent, achieve, carry(Lat, Long)).
+!handed_over(_, _) <- +handed; .print("the task is done").

// Whoever sent it home or down (this program, the operator, a pilot, its own failsafe): coming home is coming home.
coming_home(Mode) :- state(Mode, true, true) & .member(Mode, ["RTL", "SMART_RTL", "LAND", "AUTOLAND"]).

+!safe : coming_home(_) | not state(_, _, true).
+!safe : override(Mode) <- .print("left to those who have it, in ", Mode).
+!safe <- return_to_launch.
-!safe[error_msg(Why)] <- .print("cannot return: ", Why).
