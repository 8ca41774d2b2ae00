"""agentd.mind.persistence."""
