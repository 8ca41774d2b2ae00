"""Part `reasoner`: speed, start and memory of the reasoner beside its peers."""
