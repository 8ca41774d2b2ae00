"""Agents on the bus, as the daemon runs them.

`agent_group` creates and removes agents, `agent_host` connects one mind to the bus, `mind_runner` gives it turns;
`action_client`, `view_server` and `operator_control` are its connections, `agent_directory` knows the other agents.
`program_loader` loads the agents of a mission, `program_paths` finds and compiles the files of programs.
"""
