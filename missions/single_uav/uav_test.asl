/* Tests of uav.asl with a vehicle that only pretends:

       agentd test --env missions/single_uav/vehicle.py:Vehicle missions/single_uav

   Each test plan runs in a fresh agent. The goal that uav.asl begins with is not pursued by itself here. */

// Before uav.asl, so that it is chosen first: a step that a restart of the bridge cuts short, so many times.
+!visited(_, _, _) : restarts(N) & N > 0 <- -+restarts(N - 1); .fail(cause(restart), error_msg("the bridge restarted")).

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

@what_a_bridge_cuts_short_goes_on_in_the_air[test]
+!what_a_bridge_cuts_short_goes_on_in_the_air
  <- +restarts(3);
     !fly_mission;
     !assert_true(mission_done);
     ?did(Actions);
     !assert_equals([return_to_launch, goto, takeoff, arm_motors, set_mode], Actions).

@what_others_took_meanwhile_does_not_go_on[test]
+!what_others_took_meanwhile_does_not_go_on
  <- +restarts(1);
     !!fly_mission;
     .wait(8700);
     be_sent("LOITER");
     .wait(mission_failed("the bridge restarted"), 100000);
     ?did(Actions);
     !assert_not_contains(Actions, goto).

@what_was_disarmed_after_takeoff_is_not_armed_again[test]
+!what_was_disarmed_after_takeoff_is_not_armed_again
  <- !airborne(5);
     land;
     !fly_mission;
     !assert_true(mission_failed("its motors were stopped after takeoff"));
     ?did(Actions);
     .count(.member(arm_motors, Actions), Times);
     !assert_equals(1, Times).

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

@the_way_there_is_not_flown_again_after_a_restart[test]
+!the_way_there_is_not_flown_again_after_a_restart
  <- arm_motors(true);
     +homeward;
     !fly_mission;
     !assert_true(mission_done);
     !assert_true(did([return_to_launch, arm_motors])).

@what_was_given_up_before_a_restart_comes_home[test]
+!what_was_given_up_before_a_restart_comes_home
  <- arm_motors(true);
     !given_up("blown away");
     !assert_true(did([return_to_launch, arm_motors]));
     !assert_true(mission_failed("blown away")).

@what_others_send_home_is_waited_for_and_not_ordered_again[test]
+!what_others_send_home_is_waited_for_and_not_ordered_again
  <- arm_motors(true);
     be_sent("RTL");
     !given_up("the mode became RTL");
     !assert_true(state("RTL", _, false));
     !assert_true(did([arm_motors]));
     !assert_true(mission_failed("the mode became RTL")).

@an_order_that_shows_late_is_coming_home_too[test]
+!an_order_that_shows_late_is_coming_home_too
  <- arm_motors(true);
     break_down(return_to_launch, "operator: rtl");
     !!given_up("operator: rtl");
     .wait(41000);
     be_sent("RTL");
     .wait(mission_failed(_), 100000);
     !assert_true(did([arm_motors])).
