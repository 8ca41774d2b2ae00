"""The syntax tree: `nodes`, `printer`, `traversal`, `signatures`, `source`, `errors`."""
