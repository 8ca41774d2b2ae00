"""schemas.mission."""
