"""What Argosy costs and how fast it is, measured by its own daemons: `make bench`.

`parts` is the table of what is measured; each part is a module of `measurements`, or `reasoner`, and writes its figures
to `results/`, of which `pages` makes the tables and pictures of the documentation. `__main__` is the command, `apart`
runs one part in a process of its own, and `earlier` compares parts with an earlier revision. `processes`, `serving`,
`flights` and `health` run daemons and observe them; `spread` and `plots` make figures of values; `peers` has what
others published; `imperative` are the programs in Python that fly the missions of the agents.
"""
