// Sprays rows of a field, as long as the tank has something and the board is not too hot.

row(10). row(14). row(18).              // metres north

!spray_all.

+!spray_all
  <- .wait(bridge(up) & tank(_) & temperature(_), 120000);
     set_mode("GUIDED");
     arm_motors(true);
     takeoff(5);
     .wait(climb(Rate) & math.abs(Rate) < 0.3, 10000);       // m/s: it hovers
     for (row(North)) { !row_sprayed(North); }
     return_to_launch;
     +sprayed.
-!spray_all[error_msg(Why)]
  <- .print("given up: ", Why);
     nozzle(1000);
     return_to_launch;
     +gave_up(Why).

// Started again in mid-field: which rows are wet nobody knows any more.
+restarted(_) : not sprayed & not gave_up(_)
  <- .wait(bridge(up) & state(_, _, _), 120000);
     nozzle(1000);
     return_to_launch;
     +gave_up("started again").

+!row_sprayed(_) : temperature(T) & T > 70 <- .fail(error_msg("the board is too hot")).
+!row_sprayed(North)
  <- move(North, 0, 5);
     nozzle(1900);
     !pumped(2);
     move(North, 10, 5);
     nozzle(1000);
     ?tank(Left);
     .print("row at ", North, " m sprayed, ", Left, " l left").

+!pumped(Litres) <- pump(Litres).
-!pumped(_)[error_msg(Why)]        // a row that gets too little is no reason to crash
  <- .print("not pumped: ", Why).
