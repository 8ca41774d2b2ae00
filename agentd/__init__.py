"""What the agent thinks: the AgentSpeak language, the mind that runs it, and the agent daemon."""
