/* One step to the right and one up, as cmd_vel of the paper's manifest can: linear velocities, of which each holds for
   a second. Poses are numbers. */

!walk.

+!walk
  <- .wait(bridge(up), 120000);
     .wait(pose(_, _, _), 60000);
     ?pose(X, Y, _);
     cmd_vel(1.5, 0.0, 0.0);
     .wait(pose(X1, _, _) & X1 > X + 1.4, 10000);
     cmd_vel(0.0, 1.5, 0.0);
     .wait(pose(_, Y1, _) & Y1 > Y + 1.4, 10000);
     ?pose(X2, Y2, Theta);
     .print("from ", X, ", ", Y, " to ", X2, ", ", Y2, ", heading ", Theta);
     +walked.

-!walk[error_msg(Why)] <- .print("given up: ", Why); +gave_up(Why).
