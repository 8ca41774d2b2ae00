"""schemas.files."""
