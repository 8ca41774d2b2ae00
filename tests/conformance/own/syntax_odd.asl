// Rules 105 and 110: semicolons, blanks, comments and names where they are odd but right.
begin(1). end(2). include(3). default(8). /* a /* b */ // c /* d
!s.
?q(5).
+?q(X) <- .print("q ", X).
+!s : true<-.print("a // b /* c */");.print("b")  ;
 if(1<2){.print(c);}
 if (2 < 1) { .print(no) } else { .print(d) }
 for(.member(X,[1,2])){.print(X)};
 while(false){};
 (.print(e); .print(f)); (1 < 2); (Y = 3 & Y > 2) /**/ ; // t
 /***/ .print(.5, " ", 1E2, " ", 007, " ", +2); ?begin(B); ?default(D); .print(B, D);.
