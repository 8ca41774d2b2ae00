"""`argosy doctor`: inspect a running fleet. Each `*_checks` module makes findings on one subject."""
