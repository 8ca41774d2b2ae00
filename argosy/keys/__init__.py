"""`argosy keys`: the certificate authority of a fleet. No key expressions: those are `schemas.wire.keys`."""
