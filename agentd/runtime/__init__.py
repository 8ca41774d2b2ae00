"""Agents on the bus, as the daemon runs them.

`agent_group` creates and removes agents, `agent_host` connects one mind to the bus; `action_client`,
`service_client`, `view_server` and `operator_control` are its connections, `agent_directory` and
`presence_beliefs` know the others. `program_loader` composes programs; `wakeup_timer` schedules reasoning.
"""
