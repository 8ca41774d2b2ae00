"""Checkpoints of agents on disk.

`checkpointer` decides when, `checkpoint` is the file's content, `sqlite_file` the file; `restore` and `restart` bring
an agent back after its process ended; `poison_inputs` sets an input aside that ends the process again and again.
"""
