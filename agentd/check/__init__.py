"""Static analysis of programs: what can be told to be wrong before an agent runs."""
