"""The belief base: storage and indexes, unification, rules and queries, functions and relations.

`belief_base` holds predicates, `unification` matches, `dynamic_formulas` solves formulas that are known only at run
time, `work_limit` bounds how long one formula may take.
"""
