// A service is known by its text, and provider(Agent,Service) has it as a string, whether it was offered as one or as an atom. (the part of ann)
!go.
+!go <- .df_subscribe(initiator).
+provider(A,initiator) <- .print("an atom").
+provider(A,"initiator") <- .print(A, " provides a string").
