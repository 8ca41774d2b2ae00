/* Tests of uav.asl with a vehicle that only pretends:

       agentd test --env missions/single_uav/vehicle.py:Vehicle missions/single_uav

   Each test plan runs in a fresh agent. The goal that uav.asl begins with is not pursued by itself here. */

{ include("uav.asl") }

takeoff_altitude(5).
waypoint(-27.603683, -48.518052, 40).

@a_mission_ends_at_home[test]
+!a_mission_ends_at_home
  <- !fly_mission;
     !assert_true(mission_done);
     !assert_true(state(_, _, false));
     ?did(Actions);
     !assert_equals([return_to_launch, goto, takeoff, arm_motors, set_mode], Actions).

@a_vehicle_that_is_armed_is_not_armed_again[test]
+!a_vehicle_that_is_armed_is_not_armed_again
  <- arm_motors(true);
     !airborne(5);
     ?did(Actions);
     .count(.member(arm_motors, Actions), Times);
     !assert_equals(1, Times).

@a_waypoint_that_is_not_reached_brings_the_vehicle_home[test]
+!a_waypoint_that_is_not_reached_brings_the_vehicle_home
  <- break_down(goto, "blown away");
     !fly_mission;
     !assert_false(mission_done);
     !assert_true(mission_failed("blown away"));
     ?did([Last|_]);
     !assert_equals(return_to_launch, Last).

@a_vehicle_that_cannot_return_lands_where_it_is[test]
+!a_vehicle_that_cannot_return_lands_where_it_is
  <- break_down(goto, "blown away");
     break_down(return_to_launch, "no position");
     !fly_mission;
     ?did(Actions);
     !assert_contains(Actions, land);
     !assert_not_contains(Actions, return_to_launch).

@nothing_is_done_about_a_vehicle_on_the_ground[test]
+!nothing_is_done_about_a_vehicle_on_the_ground
  <- !safe;
     !assert_true(did([])).
