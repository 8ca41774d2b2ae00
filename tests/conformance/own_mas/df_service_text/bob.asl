// A service is known by its text, and provider(Agent,Service) has it as a string, whether it was offered as one or as an atom.
!go.
+!go <- .df_register(initiator); .wait(300); .stopMAS.
