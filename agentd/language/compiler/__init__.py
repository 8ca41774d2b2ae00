"""Compile plans, rules and queries to Python code that runs on a mind.

`compile` compiles a program; `plan`, `body`, `control_flow` and `steps` its plans, `formulas`, `matching`,
`compile_relation` and `compile_terms` what stands in them, `selection` the choice among plans, `compile_rule` rules.
`code_writer` holds the code being written, `plan_code` what comes out.
"""
