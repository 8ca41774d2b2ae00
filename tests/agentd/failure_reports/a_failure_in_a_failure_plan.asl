!start.
+!start <- !fly.
+!fly <- .fail.
-!fly <- .send(bbo, tell, failed).
