/* A copter that hops: it takes off, flies to a place near its home, and returns. Three agents run this program, each
   with its own hop(Latitude, Longitude, Height) of the mission file; height in metres above home. */

!hop.

+!hop : hop(_, _, Height)
  <- .wait(bridge(up), 120000);
     set_mode("GUIDED");
     arm_motors(true);
     +departed;
     takeoff(Height);
     !across.
-!hop[error_msg(Why)] <- !given_up(Why).

+!across : hop(Lat, Long, Height)
  <- .print("hopping at ", Height, " m");
     goto(Lat, Long, Height);
     +there;
     !home.

+!home
  <- return_to_launch;
     .print("home again");
     +hopped.

// Whatever went wrong, what flies comes home before the hop is given up.
+!given_up(Why)
  <- .print("cannot hop: ", Why);
     !down;
     +gave_up(Why).

// Whoever sent it home or down (this program, the operator, a pilot, its own failsafe): coming home is coming home.
coming_home(Mode) :- state(Mode, true, true) & .member(Mode, ["RTL", "SMART_RTL", "LAND"]).

+!down : coming_home(Mode) <- .print("coming home in ", Mode); .wait(not coming_home(_), 900000, _); !down.
+!down : state(_, _, true) <- return_to_launch.
+!down.
-!down[error_msg(Why)] <- .wait(coming_home(_), 3000, _); !otherwise(Why).    // an order may not show yet

+!otherwise(_) : coming_home(_) <- !down.
+!otherwise(_) : override(Mode) <- .print("left to those who have it, in ", Mode).
+!otherwise(Why) <- .print("cannot return: ", Why); land.

// Started again by a supervisor after a death: what has been there comes home, and what flies goes on.
+restarted(_) : not hopped & not gave_up(_)
  <- .print("started again");
     .wait(state(_, true, _) & altitude(_), 120000);
     !go_on.

+!go_on : there <- !home.
+!go_on : override(_) <- .fail(error_msg("others have it")).
+!go_on : state(_, _, true) & altitude(A) & A > 1 <- set_mode("GUIDED"); !across.
+!go_on : state(_, _, true) | not departed <- !hop.     // it arms once: whoever has landed a vehicle had a reason
-!go_on[error_msg(Why)] <- !given_up(Why).
