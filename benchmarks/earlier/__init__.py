"""What was slow in an earlier revision and is not now: both, by the same probes, in turn, in one run."""
