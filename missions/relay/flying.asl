/* Copters and planes, of ArduPilot or PX4: they take off, and are home again when they have landed, or when a plane that
   lands on no order circles above home. A plane with PX4 lands by the items that landing(Items) of the mission file has. */

{ include("relay.asl") }

landing([]).                                 // unless the mission file has items

// In the air already: a takeoff was cut short, and goes on. A plane's is not ended near the ground.
+!departed : state("TAKEOFF", _, true) & height(Height) <- takeoff(Height).
+!departed : state(_, _, true) & altitude(A) & A > 2 & height(Height) & A < Height - 5
  <- set_mode("GUIDED"); takeoff(Height).
+!departed : state(_, _, true) & altitude(A) & A > 2 <- set_mode("GUIDED").
+!departed : height(Height)
  <- !in_hand;
     arm_motors(true);
     .print("taking off to ", Height, " m");
     takeoff(Height).

// A copter takes off in the mode that takes orders; a plane has a mode for its takeoff, and enters it by itself.
+!in_hand : landing(Items) & Items \== [] <- upload_mission(Items); set_mode("GUIDED").
+!in_hand <- set_mode("GUIDED").

+!visited(Lat, Long) : height(Height) <- goto(Lat, Long, Height).

+!home_again <- return_to_launch; !down.

+!down : not state(_, _, true).
+!down <- land.
-!down[error_msg(Why)] <- .print("circles above home: ", Why).
