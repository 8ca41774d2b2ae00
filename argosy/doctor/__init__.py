"""`argosy doctor`: inspect a running fleet; `fleet_checks` judge gathered facts, `security_checks` try connections."""
