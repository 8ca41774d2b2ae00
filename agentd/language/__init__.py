"""The AgentSpeak language, from text to generated Python code.

`parse` is the entry: text to syntax tree, or all that is wrong with the text. It rests on `parser` (grammar, parse
tables, lexer, syntax tree builder), `syntax_tree` (nodes, printer, traversal) and `errors` (messages).
`terms` are run-time values, `compiler` makes Python code of plans, rules and queries.
Nothing here does I/O or knows of a mind's state.
"""
