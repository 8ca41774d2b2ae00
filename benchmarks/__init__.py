"""Measure the cost and the speed of Argosy by its own daemons: `make bench`.

`parts` is the table of parts; each part is a module of `measurements`, or `reasoner`, and writes its figures to
`results/`, from which `pages` makes the tables and pictures of the documentation. `__main__` is the command, `apart`
runs one part in a process of its own, and `earlier` compares parts with an earlier revision. `processes`, `serving`,
`flights` and `health` run daemons and observe them; `spread` and `plots` make figures of values; `peers` has figures
of other publications; `imperative` has the Python programs that fly the missions of the agents.
"""
