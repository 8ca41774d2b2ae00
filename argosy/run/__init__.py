"""`argosy run`: run a mission on this machine.

`command` is the command line, `mission_runner` the run, `end_conditions`, `watchdog` and `recovery` decide how it
ends, `screen` and `plain_screen` show it, `report` and `summary` describe it afterwards.
"""
