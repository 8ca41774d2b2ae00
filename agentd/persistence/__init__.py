"""agentd.persistence."""
