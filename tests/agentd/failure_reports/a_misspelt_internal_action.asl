!start.
+!start <- .pirnt("hello").
