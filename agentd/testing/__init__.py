"""`agentd test`: run test plans. `discovery` finds them, `runner` runs them, `report` prints the results."""
