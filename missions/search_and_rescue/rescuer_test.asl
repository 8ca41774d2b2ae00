/* Tests of rescuer.asl, with a vehicle that only pretends and a scout that only answers:

       agentd test --env missions/search_and_rescue/vehicle.py:Vehicle missions/search_and_rescue
*/

{ include("rescuer.asl") }

height(10).
scout(book).
peers([peer]).
victim(near, -27.6038, -48.518363).
victim(far, -27.6030, -48.518363).

+!company <- .create_agent(book, "book.asl"); .create_agent(peer, "peer.asl").

+!hears(Agent, Formula) <- .send(Agent, askOne, Formula, Answer, 5000); !assert_not_equals(false, Answer).
+!hears_not(Agent, Formula) <- .send(Agent, askOne, Formula, Answer, 5000); !assert_equals(false, Answer).

@the_nearest_victim_is_rescued_first_and_told_to_all[test]
+!the_nearest_victim_is_rescued_first_and_told_to_all
  <- !company;
     !!serve;
     .wait(rescued(near), 300000);
     !assert_false(rescued(far));
     .wait(not mine(near), 1000);
     !hears(book, rescued(near));
     !hears(peer, rescued(near));
     !assert_true(did([drop_buoy, goto | _])).

@it_returns_takes_a_new_buoy_and_goes_on_to_the_next[test]
+!it_returns_takes_a_new_buoy_and_goes_on_to_the_next
  <- !company;
     !!serve;
     .wait(rescued(near) & rescued(far), 600000);
     !assert_true(did([drop_buoy, goto, takeoff, arm_motors, set_mode, load_buoy, return_to_launch, drop_buoy | _])).

@a_victim_is_left_to_one_who_is_better_placed[test]
+!a_victim_is_left_to_one_who_is_better_placed
  <- !company;
     .send(peer, tell, bid(near, offer(1, peer)));
     !!serve;
     .wait(rescued(far), 300000);
     !assert_false(rescued(near)).

@equal_bids_are_decided_by_the_name[test]
+!equal_bids_are_decided_by_the_name
  <- !company;
     ?bid(near, offer(Cost, _));
     .send(peer, tell, bid(near, offer(Cost, a_name_before_mine)));
     !!serve;
     .wait(rescued(far), 300000);
     !assert_false(rescued(near)).

@a_victim_that_is_promised_to_another_is_left_alone[test]
+!a_victim_that_is_promised_to_another_is_left_alone
  <- !company;
     +held(near, peer);
     !!serve;
     .wait(rescued(far), 300000);
     !assert_false(rescued(near)).

@a_victim_that_the_book_has_promised_it_goes_before_a_nearer_one[test]
+!a_victim_that_the_book_has_promised_it_goes_before_a_nearer_one
  <- !company;
     .my_name(Me);
     +held(far, Me);
     !!serve;
     .wait(rescued(far), 300000);
     !assert_false(rescued(near)).

@no_buoy_falls_without_leave[test]
+!no_buoy_falls_without_leave
  <- !company;
     +mine(near);
     .send(book, untell, answer(yes));
     .send(book, tell, answer(no));
     !!serve;
     .wait(not mine(near), 100000);
     .wait(not armed, 100000);
     ?did(Actions);
     !assert_not_contains(Actions, drop_buoy);
     !assert_true(aboard).

@leave_is_asked_for_again_when_no_answer_comes[test]
+!leave_is_asked_for_again_when_no_answer_comes
  <- !company;
     .send(book, tell, silent);
     +mine(near);
     !!serve;
     .wait(rescued(near), 300000);
     ?did(Actions);
     .count(.member(drop_buoy, Actions), Times);
     !assert_equals(1, Times).

@an_open_latch_means_that_the_buoy_has_dropped_whatever_the_action_said[test]
+!an_open_latch_means_that_the_buoy_has_dropped_whatever_the_action_said
  <- !company;
     be_flying(80);
     be_open;
     +mine(far);
     !restarted;
     .wait(rescued(far), 300000);
     !hears(book, rescued(far));
     ?did(Actions);
     !assert_not_contains(Actions, drop_buoy).

@a_closed_latch_means_that_it_has_not[test]
+!a_closed_latch_means_that_it_has_not
  <- !company;
     be_flying(80);
     +mine(near);
     !restarted;
     .wait(rescued(near), 300000);
     ?did(Actions);
     .count(.member(drop_buoy, Actions), Times);
     !assert_equals(1, Times).

+!restarted <- .signal({ +restarted(1) }).

@a_drop_that_fails_is_tried_again[test]
+!a_drop_that_fails_is_tried_again
  <- !company;
     break_down(drop_buoy, "the servo does not move");
     !!serve;
     .wait(rescued(near), 300000);
     !hears(book, rescued(near)).

@a_flight_that_fails_is_tried_again[test]
+!a_flight_that_fails_is_tried_again
  <- !company;
     break_down(goto, "blown away");
     !!serve;
     .wait(rescued(near), 300000);
     !hears(book, rescued(near)).

@with_too_little_battery_the_victim_is_given_back[test]
+!with_too_little_battery_the_victim_is_given_back
  <- !company;
     be_flying(35);
     +mine(near);
     +held(far, peer);
     !!serve;
     .wait(not mine(near), 1000);
     !hears(book, given_back(near));
     ?did(Actions);
     !assert_not_contains(Actions, drop_buoy).

@batteries_that_nobody_charges_do_not_stop_it[test]
+!batteries_that_nobody_charges_do_not_stop_it
  <- !company;
     be_uncharged(85);
     !!serve;
     .wait(rescued(near) & rescued(far), 600000);
     !assert_true(battery(_, _, 45)).

@the_mission_says_how_low_a_battery_may_be[test]
+!the_mission_says_how_low_a_battery_may_be
  <- !company;
     +battery_low(20);
     be_uncharged(50);
     !!serve;
     .wait(rescued(near), 300000);
     .wait(20000);
     !assert_false(rescued(far));
     !assert_true(battery(_, _, 30)).

@a_vehicle_that_does_not_know_its_battery_flies[test]
+!a_vehicle_that_does_not_know_its_battery_flies
  <- !company;
     be_uncharged(-1);
     !!serve;
     .wait(rescued(near), 300000);
     !assert_true(aboard | gone).

@who_has_nothing_to_do_rests_with_an_empty_battery_too[test]
+!who_has_nothing_to_do_rests_with_an_empty_battery_too
  <- !company;
     be_uncharged(10);
     +rescued(near); +rescued(far); +search_over;
     !!serve;
     .wait(10000);
     !assert_true(resting).

@who_does_not_know_its_home_yet_does_not_ask_to_be_carried_there[test]
+!who_does_not_know_its_home_yet_does_not_ask_to_be_carried_there
  <- !company;
     start_cold;
     !assert_false(home_pos(_, _));
     !!serve;
     .wait(1000);
     !assert_false(.intend(be_carried));
     find_home;
     .wait(rescued(near), 300000).

@it_turns_back_when_its_victim_was_promised_to_another[test]
+!it_turns_back_when_its_victim_was_promised_to_another
  <- !company;
     be_flying(80);
     +mine(near);
     +held(far, peer);
     !!serve;
     .wait(2000);
     .send(self, tell, held(near, peer));
     .wait(not mine(near), 3000);
     .wait(not armed, 60000);
     !assert_true(aboard).

@it_rests_when_the_search_is_over_and_nobody_is_missing[test]
+!it_rests_when_the_search_is_over_and_nobody_is_missing
  <- !company;
     +rescued(near); +rescued(far); +search_over;
     !!serve;
     .wait(resting, 10000);
     +victim(late, -27.6037, -48.518363);
     .wait(rescued(late), 300000);
     !assert_false(resting);
     .wait(resting, 300000);
     !assert_true(aboard & not armed).
