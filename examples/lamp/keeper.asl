!light.

+!light
  <- .wait(level(_), 20000);
     brightness(70);
     .wait(level(70), 5000);
     ?temperature(Before);
     blink(3);
     .wait(temperature(After) & After > Before, 5000);
     .print("lit at 70 %, ", After, " degrees");
     +lit.

+restarted(_) : not lit & not gave_up(_) <- !light.

-!light[error_msg(Why)] <- .print("cannot light: ", Why); +gave_up(Why).
