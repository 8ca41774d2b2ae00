"""The belief base: storage and indexes, unification, copies of terms, formulas evaluated at run time.

`belief_base` holds predicates, `unification` matches, `dynamic_formulas` solves formulas that are known only at run
time, `work_limit` bounds how long one formula may take.
"""
