// .save_agent writes text that reads back: quotes, line breaks, quoted atoms, numbers, tails, negation, namespaces, plans and rules.
// Expected from the specification, not recorded from Jason.
text("say \"hi\"", "two\nlines", 'Quoted atom', "back\\slash").
number(-3). number(0.1). number(1.0e20).
list([a,"b",[c|_T]]).
~closed(door)[kind("a\"b")].
lab::temp(20).
open(X, _, X).
big(X) :- number(X) & X > 1 & not (X == 7) | X = "q\"".
@greet[k("v\"")] +!hello(N) : N > 1 & not none <- .print("hello \"", N, "\""); if (N > 2) { .print("big") } else { .print("small") }.
+!hello(_) <- for (.member(X, ["p\"q",r])) { .print(X) }; ?big(Y); .print(Y).
!start.
+!start
   <- .add_plan({ +!added(A) <- .print("added ", A) }); +note("told at \"run\" time");
      .save_agent("saved_again.asl", [goal("g\"h")]);
      .create_agent(copy, "saved_again.asl"); .wait(200);
      .send(copy, achieve, show); .wait(300).
+!goal(G) <- .my_name(Me); .print(Me, " begins with ", G).
+!show
   <- ?text(A, B, C, D); .print(A, "|", B, "|", C, "|", D);
      .findall(N, number(N), L); .print(L); ?list(K); .print(K);
      ?~closed(door)[kind(Q)]; .print(Q); ?lab::temp(T); .print(T); ?open(1, 2, W); .print(W);
      ?note(S); .print(S); !hello(3); !hello(1); !added(5);
      .plan_label(P, greet); .print("labelled").
