/* Rovers and boats, of ArduPilot or PX4. */

{ include("relay.asl") }

+!departed <- set_mode("GUIDED"); arm_motors(true).

+!visited(Lat, Long) <- goto(Lat, Long).

+!home_again <- return_to_launch; !parked.

+!parked : not state(_, _, true).
+!parked <- arm_motors(false).
-!parked <- .wait(not state(_, _, true), 30000).     // a PX4 stops its motors by itself, when it knows that it stands
