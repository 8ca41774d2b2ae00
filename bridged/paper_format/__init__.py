"""bridged.paper_format."""
