"""``agentd test``: runs the plans of programs that are marked as tests."""
