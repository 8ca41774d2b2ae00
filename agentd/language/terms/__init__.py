"""agentd.language.terms."""
