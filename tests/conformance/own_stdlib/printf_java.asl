// .printf knows Java's flags, widths, digits, numbered places and the conversions that fit doubles and texts; others fail.
// Expected from the specification, not recorded from Jason.
!start.
+!start <- for (.range(I, 1, 16)) { !t(I) }.
+!t(1) <- .printf("%5.2f|%-8.1f|%08.3f|%+.1f|% .1f|", 3.14159, 2, 3.14159, 1, 1).
+!t(2) <- .printf("%e|%.3e|%10.2e|%E|", 12345.678, 1234.5, 0, 1234567).
+!t(3) <- .printf("%g|%g|%g|%G|", 0.00001234, 123456.7, 1234567.8, 0.0001).
+!t(4) <- .printf("%,.2f|%(.2f|%f|%.1f|", 1234567.891, -3, 1/0, 0/0).
+!t(5) <- .printf("%10s|%-10s|%S|%.2s|%b|%%|", abc, "abc", abc, abc, x).
+!t(6) <- .printf("%2$s %1$s %s %<s", a, b).
+!t(7) <- .printf("%.1f %.1f %.2f %.0f %.0f", 2.25, 0.35, 2.675, 0.5, 2.5).
+!t(8) <- .printf("%s %s %s %s", 1, [1,[2,"x"]], "q", f("q")).
+!t(9) <- .printf("%f", 1.0e22).
+!t(10) <- .printf("%d", 3).
+!t(11) <- .printf("%s %s", a).
+!t(12) <- .printf("%.2f", abc).
+!t(13) <- .printf("100%").
+!t(14) <- .printf("%-f", 1).
+!t(15) <- .printf.
+!t(16) <- .printf("fewer places", 1, 2).
-!t(N)[error(E)] <- .print(N, " ", E).
