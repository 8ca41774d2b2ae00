"""`argosy keys`: the certificate authority of a fleet. Key expressions are in `schemas.wire.keys`."""
