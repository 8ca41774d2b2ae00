/* A copter that hops: it takes off, flies to a place near its home, and returns. Three agents run this program, each
   with its own hop(Latitude, Longitude, Height) of the mission file; height in metres above home. */

!hop.

+!hop : hop(Lat, Long, Height)
  <- .wait(bridge(up), 120000);
     set_mode("GUIDED");
     arm_motors(true);
     takeoff(Height);
     .print("hopping at ", Height, " m");
     goto(Lat, Long, Height);
     return_to_launch;
     .print("home again");
     +hopped.

// Whatever went wrong, what flies comes home before the hop is given up.
-!hop[error_msg(Why)]
  <- .print("cannot hop: ", Why);
     !down;
     +gave_up(Why).

+!down : state(_, _, true) <- return_to_launch.
+!down.
-!down[error_msg(Why)] <- .print("cannot return: ", Why); land.
