"""Compile plans, rules and queries to Python code that runs on a mind.

`compile` carries out a program's directives. `units` generates what a mind loads: plans, rules and queries, from
`body` and `steps` (plan bodies), `formulas`, `matching` and `compile_terms` (what is in them) and `constants`.
`code_writer` holds the code being written.
"""
