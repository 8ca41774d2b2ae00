"""An earlier revision beside this one: both trees run the same probes in turn, and the ratios are compared."""
