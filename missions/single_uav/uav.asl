/* The paper's first mission (section 5.1): take off, fly to a waypoint, return to home, land.

   An action is an intention's step like any other: it ends when the vehicle's own state shows that it was done,
   and it fails, with the vehicle's own words, when it was not. So there is nothing to poll here. The daemons may be
   started in any order: the agent first waits for the bridge of its robot. */

!fly_mission.

+!fly_mission : takeoff_altitude(Altitude) & waypoint(Lat, Long, Height)
  <- .wait(bridge(up), 120000);
     !airborne(Altitude);
     !visited(Lat, Long, Height);
     !home_again;
     .print("mission done");
     +mission_done.

// Whatever went wrong, be it an action, a test or a plan: a flying vehicle comes home before the mission is given up.
-!fly_mission[error_msg(Why)]
  <- .print("mission failed: ", Why);
     !safe;
     +mission_failed(Why).

+!airborne(Altitude)
  <- set_mode("GUIDED");
     !armed;
     .print("taking off to ", Altitude, " m");
     takeoff(Altitude).

+!armed : state(_, _, true).
+!armed <- arm_motors(true).

+!visited(Lat, Long, Height)
  <- .print("flying to ", Lat, ", ", Long, " at ", Height, " m");
     goto(Lat, Long, Height).

+!home_again
  <- .print("returning to home");
     return_to_launch.

+!safe : state(_, true, true) <- .print("returning to home"); return_to_launch.
+!safe : state(_, false, _)
  <- .print("waiting to hear of the vehicle again");
     .wait(state(_, true, _), 300000);
     !safe.
+!safe.
-!safe[error_msg(Why)] <- .print("could not return: ", Why); !landed.

+!landed : state(_, true, true) <- .print("landing here"); land.
+!landed.
-!landed[error_msg(Why)] <- .print("could not land: ", Why, "; over to the pilot").

// The bridge was lost in flight, which failed the mission, and is back: what still flies comes home.
+state(_, true, true) : mission_failed(_) & not .intend(safe) <- !safe.
