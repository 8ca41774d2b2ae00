/* Tests of scout.asl, with a vehicle that only pretends:

       agentd test --env missions/search_and_rescue/vehicle.py:Vehicle missions/search_and_rescue
*/

{ include("scout.asl") }

area(-27.603853, -48.519300, -27.602955, -48.517300).
lane_width(25).
height(20).
rescuers([one, two]).
patience(60).
lease(300).
lost(1200).

+!company <- .create_agent(one, "peer.asl"); .create_agent(two, "peer.asl").

+!sighted(V) <- see(V, -27.603, -48.518); .wait(found(V, _, _), 1000).

+!knows(Agent, Formula) <- .send(Agent, askOne, Formula, Answer, 5000); !assert_not_equals(false, Answer).
+!knows_not(Agent, Formula) <- .send(Agent, askOne, Formula, Answer, 5000); !assert_equals(false, Answer).

@the_area_is_swept_in_four_lanes_to_and_fro[test]
+!the_area_is_swept_in_four_lanes_to_and_fro
  <- !company;
     ?lanes(4);
     ?lane(0, First, -48.5193, -48.5173);
     ?lane(1, Second, -48.5173, -48.5193);
     !assert_equals(25, (Second - First) * 111320, 0.001);
     !!search;
     .wait(mission_done, 3000000);
     !assert_true(search_over);
     !assert_false(armed);
     ?did(Actions);
     .count(.member(goto, Actions), Times);
     !assert_equals(8, Times).

@a_lane_that_was_not_flown_to_its_end_is_flown_again[test]
+!a_lane_that_was_not_flown_to_its_end_is_flown_again
  <- !company;
     break_down(goto, "blown away");
     !!search;
     .wait(mission_done, 3000000);
     ?did(Actions);
     .count(.member(goto, Actions), Times);
     !assert_equals(8, Times).

@each_rescuer_is_told_of_a_victim[test]
+!each_rescuer_is_told_of_a_victim
  <- !company;
     !sighted(7);
     !knows(one, victim(7, _, _));
     !knows(two, victim(7, _, _)).

@a_victim_is_promised_to_the_first_who_claims_it_and_to_nobody_else[test]
+!a_victim_is_promised_to_the_first_who_claims_it_and_to_nobody_else
  <- !company;
     !sighted(7);
     ?claim(7, First)[source(one)];
     ?claim(7, Second)[source(two)];
     ?claim(7, Again)[source(one)];
     !assert_equals([yes, no, yes], [First, Second, Again]);
     !knows(two, held(7, one)).

@nobody_is_promised_a_victim_that_is_not_there_or_is_rescued[test]
+!nobody_is_promised_a_victim_that_is_not_there_or_is_rescued
  <- !company;
     !sighted(7);
     +rescued(7)[source(two)];
     ?claim(7, Rescued)[source(one)];
     ?claim(8, Unknown)[source(one)];
     !assert_equals([no, no], [Rescued, Unknown]).

@a_rescuer_has_one_victim_at_a_time[test]
+!a_rescuer_has_one_victim_at_a_time
  <- !company;
     !sighted(7); !sighted(8);
     ?claim(7, yes)[source(one)];
     ?claim(8, yes)[source(one)];
     !assert_false(held(7, one));
     ?claim(7, yes)[source(two)].

@only_who_has_the_victim_may_drop[test]
+!only_who_has_the_victim_may_drop
  <- !company;
     !sighted(7);
     ?claim(7, yes)[source(one)];
     ?may_drop(7, Other)[source(two)];
     ?may_drop(7, Its)[source(one)];
     ?may_drop(7, Again)[source(one)];
     !assert_equals([no, yes, yes], [Other, Its, Again]).

@a_victim_is_free_again_when_its_rescuer_is_late[test]
+!a_victim_is_free_again_when_its_rescuer_is_late
  <- !company;
     !sighted(7);
     ?claim(7, yes)[source(one)];
     .wait(299000);
     !assert_true(held(7, one));
     .wait(2000);
     !assert_true(open(7));
     !knows_not(two, held(7, one));
     ?may_drop(7, yes)[source(two)];
     ?may_drop(7, Late)[source(one)];
     !assert_equals(no, Late).

@a_victim_is_free_again_when_its_rescuer_is_away_for_too_long[test]
+!a_victim_is_free_again_when_its_rescuer_is_away_for_too_long
  <- !company;
     !sighted(7);
     ++online(one);
     ?claim(7, yes)[source(one)];
     --online(one);
     .wait(50000);
     !assert_true(held(7, one));
     .wait(20000);
     !assert_true(open(7)).

@a_rescuer_that_comes_back_in_time_keeps_its_victim[test]
+!a_rescuer_that_comes_back_in_time_keeps_its_victim
  <- !company;
     !sighted(7);
     ++online(one);
     ?claim(7, yes)[source(one)];
     --online(one);
     .wait(50000);
     ++online(one);
     .wait(20000);
     !assert_true(held(7, one)).

@with_leave_to_drop_a_victim_stays_with_its_rescuer_however_long_that_is_away[test]
+!with_leave_to_drop_a_victim_stays_with_its_rescuer_however_long_that_is_away
  <- !company;
     !sighted(7);
     ++online(one);
     ?claim(7, yes)[source(one)];
     ?may_drop(7, yes)[source(one)];
     --online(one);
     .wait(1000000);
     ?claim(7, Other)[source(two)];
     !assert_equals(no, Other);
     +rescued(7)[source(one)];
     .wait(not held(7, _), 1000).

@in_the_end_a_rescuer_with_leave_is_lost_for_good[test]
+!in_the_end_a_rescuer_with_leave_is_lost_for_good
  <- !company;
     !sighted(7);
     ?claim(7, yes)[source(one)];
     ?may_drop(7, yes)[source(one)];
     .wait(1600000);
     ?claim(7, Other)[source(two)];
     !assert_equals(yes, Other).

@nobody_has_leave_for_a_victim_that_a_lost_one_has_rescued_after_all[test]
+!nobody_has_leave_for_a_victim_that_a_lost_one_has_rescued_after_all
  <- !company;
     !sighted(7);
     ?claim(7, yes)[source(one)];
     ?may_drop(7, yes)[source(one)];
     .wait(1600000);
     ?claim(7, yes)[source(two)];
     +rescued(7)[source(one)];
     ?may_drop(7, Leave)[source(two)];
     !assert_equals(no, Leave).

@a_victim_that_is_given_back_is_free[test]
+!a_victim_that_is_given_back_is_free
  <- !company;
     !sighted(7);
     ?claim(7, yes)[source(one)];
     ?may_drop(7, yes)[source(one)];
     !give_back(7)[source(one)];
     !assert_true(open(7)).

@promises_end_in_time_after_a_restart_too[test]
+!promises_end_in_time_after_a_restart_too
  <- !company;
     +next_lane(4); -next_lane(0);
     +found(7, -27.603, -48.518); +held(7, one);
     .signal({ +restarted(1) });
     .wait(310000);
     !assert_true(open(7)).

@what_others_send_home_is_not_called_back[test]
+!what_others_send_home_is_not_called_back
  <- !company;
     be_flying(80);
     set_mode("RTL");
     ++override("RTL");
     !!search;
     .wait(100000);
     ?did(Actions);
     !assert_equals([set_mode], Actions);
     --override("RTL");
     .wait(10000);
     !assert_true(did([set_mode]));
     set_mode("GUIDED");
     .wait(did([_, _, _ | _]), 20000).

@what_others_have_landed_while_the_bridge_was_away_waits_for_a_person[test]
+!what_others_have_landed_while_the_bridge_was_away_waits_for_a_person
  <- !company;
     !!search;
     .wait(did([goto | _]), 60000);
     lose_bridge;
     .wait(20000);
     be_landed("LAND");
     ?did(Before);
     .wait(100000);
     !assert_true(did(Before));
     set_mode("GUIDED");
     .wait(did([goto | _]), 60000).

@what_landed_at_home_while_the_bridge_was_away_goes_out_again[test]
+!what_landed_at_home_while_the_bridge_was_away_goes_out_again
  <- +next_lane(4); -next_lane(0);
     be_flying(80);
     !company;
     !!search;
     .wait(5000);
     lose_bridge;
     .wait(20000);
     be_landed("RTL");
     .wait(1000);
     !assert_false(others_have(_)).

@what_others_have_landed_waits_for_a_person[test]
+!what_others_have_landed_waits_for_a_person
  <- !company;
     ++override("LAND");
     set_mode("LAND");
     !!search;
     .wait(100000);
     !assert_true(did([set_mode])).
