/* A task is a place to be visited. Whoever has it departs, visits the place, hands the task over to the next, and comes
   home. How it departs and moves is in the program that includes this one: flying.asl or driving.asl.

   A task arrives as a goal, by the mission file or by the agent that had it before. */

+!carry(Lat, Long)[source(From)] : not task(_, _)
  <- +task(Lat, Long);
     +task_of(From);
     .wait(bridge(up), 120000);
     .wait(state(_, true, _), 120000);
     !under_way.
+!carry(_, _) <- !go_on.                     // a request of others comes again after a death
-!carry(_, _)[cause(Cause), error_msg(Why)] : passing(Cause) <- .print("interrupted: ", Why); !resumed.
-!carry(_, _)[error_msg(Why)] <- !given_up(Why).

+!under_way <- !departed; +departed; !on_the_way.

// What a silent link or a lost bridge cuts short goes on.
passing(Cause) :- .member(Cause, [link, unreachable, restart, busy]).

+!resumed <- .wait(1000); !go_on.

+!on_the_way : task(Lat, Long)
  <- .print("on the way to ", Lat, ", ", Long);
     !visited(Lat, Long);
     !handed_over;
     !home.

+!home
  <- !home_again;
     .print("home again");
     +carried.

+!handed_over : handed.
+!handed_over : next(nobody) <- +handed; .print("the task is done").
+!handed_over : next(Agent) & task(Lat, Long)
  <- +handed;
     .print("hands the task over to ", Agent);
     .send(Agent, achieve, carry(Lat, Long)).

// Whoever cannot go on hands the task over all the same, and comes home before it gives up.
+!given_up(Why)
  <- .print("cannot carry the task: ", Why);
     !handed_over;
     !safe;
     +gave_up(Why).

// Whoever sent it home or down (this program, the operator, a pilot, its own failsafe): coming home is coming home.
coming_home(Mode) :- state(Mode, true, true) & .member(Mode, ["RTL", "SMART_RTL", "LAND", "AUTOLAND"]).

+!safe : coming_home(_) | not state(_, _, true).
+!safe : override(Mode) <- .print("left to those who have it, in ", Mode).
+!safe <- return_to_launch.
-!safe[error_msg(Why)] <- .print("cannot return: ", Why).

// Started again by a supervisor after a death: a task of its own goes on, one of others comes again as a request.
+restarted(_) : task_of(self) & not carried & not gave_up(_) <- .print("started again"); !go_on.

// What has handed its task over comes home, and what is under way goes on: nothing is armed twice.
+!go_on
  <- .wait(bridge(up), 120000);
     .wait(state(_, true, _), 120000);
     !continue.
-!go_on[cause(Cause), error_msg(Why)] : passing(Cause) <- .print("interrupted: ", Why); !resumed.
-!go_on[error_msg(Why)] <- !given_up(Why).

+!continue : carried | gave_up(_).
+!continue : handed <- !home.
+!continue : override(_) <- .fail(error_msg("others have it")).
+!continue : departed & state(_, _, true) <- set_mode("GUIDED"); !on_the_way.
+!continue : not departed <- !under_way.
+!continue <- .fail(error_msg("its motors were stopped on the way")).     // whoever did that had a reason
