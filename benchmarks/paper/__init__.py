"""The paper's experiments: what agents and imperative programs use in flight, and how long the programs are."""
