// Checks for test plans. Each knows the plan and the formula that it was called from.

@check_same +!same(X, Y)
    :  .intention(Id, _, [im(Label, { +!Goal }, { Formula; _ }, _)|_], current) & X == Y
  <- +checked(Label, Formula).

@check_same_about +!same(X, Y, Tolerance)
    :  .number(X) & .number(Y) & math.abs(X - Y) <= Tolerance
  <- true.

-!same(X, Y)     <- .fail(error_msg("values differ"), values(X, Y)).
-!same(X, Y, T)  <- .fail(error_msg("values differ by more than the tolerance"), values(X, Y, T)).
