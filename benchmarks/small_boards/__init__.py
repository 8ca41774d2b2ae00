"""The paper's first mission within the limits of small boards."""
