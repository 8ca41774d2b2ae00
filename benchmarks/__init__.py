"""Benchmarks: the reasoner of agentd beside its peers."""
