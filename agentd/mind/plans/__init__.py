"""The plan library: plans by trigger, plans as terms, nested plans, usage."""
