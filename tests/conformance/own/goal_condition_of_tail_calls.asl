// Rule 94: a goal with a condition that calls itself last.
!s. +!s <- !loop(0); .print(end). +!loop(N) <: stop <- .print(N); if (N > 2) { +stop }; !loop(N+1).
