!start.
+!start <- .fail(reason(wind), error_msg("too windy to fly")).
