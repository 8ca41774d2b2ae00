"""schemas.manifest."""
