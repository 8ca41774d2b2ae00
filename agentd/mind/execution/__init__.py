"""The reasoning cycle and everything that it calls.

`cycle` is the loop. `input_handling` takes inputs, `event_selection` and `option_selection` choose, `execution` runs,
ends and fails intentions, `waiting` suspends and resumes them, `goal_execution` and `belief_updates` run formulas of
plan bodies, `control_flow` their forks and loops, `messages` is communication, `generated_code_api` is what generated
code calls.
"""
