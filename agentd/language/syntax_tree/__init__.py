"""The syntax tree: `nodes`, `printer`, `traversal`, names (`namespaces`, `signatures`), `source`, `errors`."""
