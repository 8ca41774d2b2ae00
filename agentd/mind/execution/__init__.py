"""What runs: the reasoning cycle and all that it calls.

`cycle` is the loop. `input_handling` takes inputs, `event_selection` and `option_selection` choose, `execution` runs,
ends and fails intentions, `waiting` is ``.wait``, `goal_execution` handles goals; `receive_message` and
`send_message` are communication, `generated_code_api` is what generated code calls.
"""
