"""agentd.language.compiler."""
