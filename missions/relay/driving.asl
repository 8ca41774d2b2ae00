/* Rovers and boats, of ArduPilot or PX4. */

{ include("relay.asl") }

+!departed <- set_mode("GUIDED"); arm_motors(true).

+!visited(Lat, Long) <- goto(Lat, Long).

+!home_again <- return_to_launch.
