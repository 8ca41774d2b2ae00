"""Checkpoints of the agents of a daemon on disk.

`checkpoint` is the file, `checkpointer` says what of an agent is to be saved and when, `group_commit` saves all agents
together, `restore` finds the file and brings an agent back after its process ended; `poison_inputs` skips an input that
ends the process again and again.
"""
