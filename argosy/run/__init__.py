"""`argosy run`: run a mission on this machine.

`command` is the command line, `mission_runner` the run, `end_conditions` and `recovery` decide how it ends, `screen`
shows it, `summary` describes it afterwards, `armed_warnings` warns of vehicles that are left in the air.
"""
