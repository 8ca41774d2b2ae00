battery(12). position(1,2).
!start.
+!start <- !fly(5).
@careful +!fly(H) : battery(B) & B > 20.
+!fly(H) : position(X,Y) & Y > H.
+!fly(home).
+!fly(H) : .random(R) & R > 2.
