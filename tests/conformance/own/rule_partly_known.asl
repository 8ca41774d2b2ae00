// rules that compare, negate and compute what they are asked with in part
heavy(box(W,_)) :- W > 10.
safe(cell(X,_)) :- not mine(X).
mine(3).
diff(p(A,B)) :- A \== B & place(B).
place(a). place(b).
path([X]) :- goal(X).
path([X,Y|T]) :- edge(X,Y) & path([Y|T]).
edge(a,b). edge(b,c). edge(b,d). goal(d).
twins(A,B) :- place(A) & not odd(B).
odd(a).
first([X|_],Y) :- X == a & Y = X.
x(1).

!start.
+!start
  <- if (heavy(box(5,_))) { .print("5 is heavy") } else { .print("5 is light") };
     if (heavy(box(50,_))) { .print("50 is heavy") };
     if (safe(cell(3,_))) { .print("3 is safe") } else { .print("3 is mined") };
     if (safe(cell(4,_))) { .print("4 is safe") };
     .findall(B, diff(p(a,B)), L); .print(L);
     ?path([a|T]); .print([a|T]);
     .findall(X, twins(X,X), Twins); .print(Twins);
     if (first([a|_],F)) { .print(F) };
     for (x(A)[source(S)]) { .print(A," from ",S) };
     for (x(A2)[source(self)]) { .print(A2) }.
