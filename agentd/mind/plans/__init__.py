"""The plan library: plans by trigger, plans as terms, nested plans, built-in plans, usage."""
