/* Draws a line from corner to corner. A command of velocity holds for a second, and succeeds when a turtle hears it:
   that it moved shows in its pose alone, so each command is made from the pose of the moment. */

// How far a place is ahead of the turtle and to its left.
off(X, Y, X*math.cos(T) + Y*math.sin(T) - (PX*math.cos(T) + PY*math.sin(T)),
          Y*math.cos(T) - X*math.sin(T) - (PY*math.cos(T) - PX*math.sin(T))) :- pose(PX, PY, T).
near(X, Y) :- off(X, Y, Ahead, Left) & Ahead*Ahead + Left*Left < 0.0025.
facing(Ahead, Left) :- Ahead > 0 & math.abs(Left) < 0.05 * Ahead + 0.03.

!draw.

+!draw : corners([[X, Y]|Others])
  <- .wait(bridge(up), 120000);
     .wait(pose(_, _, _), 60000);
     set_pen(255, 255, 255, 4, true);       // the way to the first corner is not drawn
     !visited(X, Y);
     set_pen(255, 255, 255, 4, false);
     for (.member([NextX, NextY], Others)) {
        .print("to ", NextX, ", ", NextY);
        !visited(NextX, NextY);
     }
     .print("drawn");
     +drawn.

+restarted(_) : not drawn & not gave_up(_) <- !draw.       // from the first corner on

-!draw[error_msg(Why)] <- .print("given up: ", Why); +gave_up(Why).

+!visited(X, Y) : near(X, Y) <- cmd_vel(0, 0, 0).
+!visited(X, Y) : off(X, Y, Ahead, Left) & facing(Ahead, Left)
  <- cmd_vel(math.min(2, 2 * Ahead), 0, 2 * Left / (Ahead + 0.1));
     .wait(100);
     !visited(X, Y).
+!visited(X, Y) : off(X, Y, Ahead, Left) & Ahead > 0
  <- cmd_vel(0, 0, 2 * Left / math.sqrt(Ahead*Ahead + Left*Left));
     .wait(100);
     !visited(X, Y).
+!visited(X, Y) : off(X, Y, _, _)           // it lies behind
  <- cmd_vel(0, 0, 2);
     .wait(100);
     !visited(X, Y).
