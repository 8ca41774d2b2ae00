"""Checkpoints of agents on disk.

`checkpointer` decides when to save, `checkpoint` is the file, `restore` brings an agent back after its process ended;
`poison_inputs` skips an input that ends the process again and again.
"""
