"""Terms at run time: `terms` (variables, literals, lists, code), their `order` and `format`, numbers, annotations.

`from_ast` makes terms of syntax, `to_ast` syntax of terms.
"""
