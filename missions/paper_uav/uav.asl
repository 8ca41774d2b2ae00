/* The paper's first mission (section 5.1) as an agent of the paper's bridge would be written: it polls its beliefs.

   The robot's manifest is the pair of INI files beside this program, so percepts have the text semantics of the paper:
   state(Mode, Connected, Armed) is told as state("GUIDED","True","False"), altitudes and positions are numbers, and
   True in arm_motors(True) is a free variable of which the bridge takes the name. What is new: an action that returns
   has had its effect, and one that had none fails with the reason, so nothing here is tried again and again. */

!mission.

+!mission : takeoff_altitude(Alt) & waypoint(Lat, Long, AMSL)
  <- .wait(state(_,"True",_));
     .print("the vehicle is connected");
     !mode("GUIDED");
     !armed;
     !airborne(Alt);
     !at(Lat, Long, AMSL);
     !home_again;
     .print("mission done");
     +mission_done.

-!mission[error_msg(Why)]
  <- .print("mission failed: ", Why);
     !safe;
     +mission_failed(Why).

+!mode(Mode) : state(Mode,_,_).
+!mode(Mode)
  <- set_mode(Mode);
     .wait(state(Mode,_,_), 3000).

+!armed : state(_,_,"True").
+!armed
  <- arm_motors(True);
     .wait(state(_,_,"True"), 3000).

+!airborne(Alt)
  <- .print("taking off to ", Alt, " m");
     takeoff(Alt);
     .wait(altitude(A) & math.abs(A - Alt) <= 0.5, 60000).

+!at(Lat, Long, AMSL)
  <- .print("flying to ", Lat, ", ", Long, " at ", AMSL, " m above the sea");
     setpoint(Lat, Long, AMSL);
     .wait(global_pos(X, Y) & math.abs(X - Lat) <= 0.00001 & math.abs(Y - Long) <= 0.00001, 120000).

+!home_again
  <- .print("returning to home");
     !mode("RTL");
     .wait(global_pos(X, Y) & home_pos(HX, HY) & math.abs(X - HX) <= 0.00001 & math.abs(Y - HY) <= 0.00001
           & altitude(A) & math.abs(A) <= 0.1 & state(_,_,"False"), 300000).

// Whoever sent it home or down (the operator, a pilot, its own failsafe): coming home is coming home.
coming_home :- state(Mode,_,"True") & .member(Mode, ["RTL", "LAND"]).

+!safe : coming_home <- .print("coming home").
+!safe : state(_,_,"True") <- .print("returning to home"); set_mode("RTL").
+!safe.
-!safe[error_msg(Why)] <- .wait(coming_home, 3000, _); !otherwise(Why).    // an order may not show yet

+!otherwise(_) : coming_home <- .print("coming home").
+!otherwise(Why) <- .print("could not return: ", Why, "; over to the pilot").
