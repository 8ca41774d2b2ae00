"""`agentd test`: run test plans. `discovery` finds them, `runner` runs them, `command` reports the results."""
