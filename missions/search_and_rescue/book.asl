/* A scout that only answers, for the tests of the rescuer: yes or no as it is told, and it keeps what it hears. */

answer(yes).

+?claim(_, Answer) : answer(Answer).
+?may_drop(_, Answer) : silent[source(S)] <- -silent[source(S)]; .wait(60000); ?answer(Answer).
+?may_drop(_, Answer) : answer(Answer).
+!give_back(V) <- +given_back(V).
