// Surveys each sector that it is asked to, and says what it has found there.

victims(north, 0).
victims(east, 2).
victims(south, 1).

+!survey(Sector)[source(Planner)] : victims(Sector, N)
   <- .print("on my way ", Sector);
      .wait(100);
      .send(Planner, tell, surveyed(Sector, N)).

+!survey(Sector)[source(Planner)]
   <- .send(Planner, tell, unknown(Sector)).

+!stand_down <- +relieved.
