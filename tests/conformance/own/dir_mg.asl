// Goal patterns: a maintenance goal is adopted when it is believed no longer.
{ begin mg(light) }
+!light <- .print("switch on"); +light.
{ end }
!s.
+!s <- if (light) { .print("on at the start") }; --light; .wait(50); if (light) { .print("on again") }.
