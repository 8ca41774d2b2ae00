// A belief has no body.
b(1).
b(1) <- c.
