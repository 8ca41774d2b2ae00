/* The paper's first mission (section 5.1): take off, fly to a waypoint, return to home, land.

   An action is an intention's step like any other: it ends when the vehicle's own state shows that it was done,
   and it fails, with the vehicle's own words, when it was not. So there is nothing to poll here. The daemons may be
   started in any order: the agent first waits for the bridge of its robot. */

!fly_mission.

+!fly_mission : takeoff_altitude(Altitude) & waypoint(Lat, Long, Height)
  <- .wait(bridge(up), 120000);
     !heard;
     !airborne(Altitude);
     !visited(Lat, Long, Height);
     !home_again;
     .print("mission done");
     +mission_done.

// What a silent link or a lost bridge cuts short goes on where the vehicle still waits for orders, in the air in GUIDED:
// whoever took it meanwhile has set another mode. Neither the mode nor the motors are touched for that.
-!fly_mission[cause(Cause), error_msg(Why)] : .member(Cause, [link, unreachable, restart, busy])
  <- .print("interrupted: ", Why);
     !resumed(Why).

+!resumed(Why) <- .wait(1000); !heard; !carried_on(Why).
-!resumed(Why) <- .print("mission failed: ", Why); !given_up(Why).

+!carried_on(_) : aloft & state("GUIDED", _, _) & not override(_) <- !fly_mission.
+!carried_on(_) : homeward & (coming_home(_) | state(_, true, false))
  <- .wait(not coming_home(_), 900000, _);
     !fly_mission.

// Whatever else went wrong, be it an action, a test or a plan: a flying vehicle comes home before the mission is given up.
-!fly_mission[error_msg(Why)]
  <- .print("mission failed: ", Why);
     !given_up(Why).

+!given_up(Why)
  <- +failing(Why);
     !safe;
     +mission_failed(Why).

// Started again by a supervisor after a death: it goes on by what it believes, and does not fly the way there twice.
+restarted(_) : failing(Why) <- !heard; !given_up(Why).
+restarted(_) : not mission_done <- .print("started again"); !go_on.

+!go_on <- !heard; !superseded; !fly_mission.
-!go_on[error_msg(Why)] <- !given_up(Why).

// An action of the life before may still run, and the next one would be refused as busy: the mode ends it.
+!superseded : aloft & state("GUIDED", _, _) & not homeward <- set_mode("GUIDED").
+!superseded.

+!heard <- .wait(state(_, true, _) & altitude(_), 120000).

aloft :- state(_, _, true) & altitude(A) & A > 1.

+!airborne(_) : homeward.
+!airborne(_) : aloft & state("GUIDED", _, _).
+!airborne(_) : aloft & not override(_) <- set_mode("GUIDED").      // the bridge has held it meanwhile
+!airborne(Altitude) : not aloft & not override(_)
  <- set_mode("GUIDED");
     !armed;
     .print("taking off to ", Altitude, " m");
     +departed;
     takeoff(Altitude).
+!airborne(_) <- .fail(error_msg("others have it")).

+!armed : state(_, _, true).
+!armed : not departed <- arm_motors(true).
+!armed <- .fail(error_msg("its motors were stopped after takeoff")).     // whoever did that had a reason

+!visited(_, _, _) : homeward.
+!visited(Lat, Long, Height)
  <- .print("flying to ", Lat, ", ", Long, " at ", Height, " m");
     goto(Lat, Long, Height).

+!home_again
  <- +homeward;
     .print("returning to home");
     return_to_launch.

// Whoever sent it home or down (this program, the operator, a pilot, its own failsafe): coming home is coming home.
coming_home(Mode) :- state(Mode, true, true) & .member(Mode, ["RTL", "SMART_RTL", "LAND"]).

+!safe : coming_home(Mode) <- .print("coming home in ", Mode); .wait(not coming_home(_), 900000, _); !safe.
+!safe : state(_, true, true) <- .print("returning to home"); return_to_launch.
+!safe : state(_, false, _)
  <- .print("waiting to hear of the vehicle again");
     .wait(state(_, true, _), 300000);
     !safe.
+!safe.
-!safe[error_msg(Why)] <- .wait(coming_home(_), 3000, _); !otherwise(Why).    // an order may not show yet

+!otherwise(_) : coming_home(_) <- !safe.
+!otherwise(_) : override(Mode) <- .print("left to those who have it, in ", Mode).
+!otherwise(Why) <- .print("could not return: ", Why); !landed.

+!landed : state(_, true, true) <- .print("landing here"); land.
+!landed.
-!landed[error_msg(Why)] <- .print("could not land: ", Why, "; over to the pilot").

// The bridge was lost in flight, which failed the mission, and is back: what still flies comes home.
+state(_, true, true) : mission_failed(_) & not .intend(safe) <- !safe.
