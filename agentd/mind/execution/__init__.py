"""The reasoning cycle and everything that it calls.

`cycle` is the loop, and finds the plan for an event. `input_handling` takes inputs, `option_selection` chooses by
functions and rules, `execution` runs, ends and fails intentions, `waiting` suspends and resumes them, `goal_execution`
and `belief_updates` run formulas of plan bodies, `control_flow` their forks and loops, `messages` is communication.
"""
