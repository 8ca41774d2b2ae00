"""The AgentSpeak language, from text to generated Python code.

`parser` (grammar, parse tables, lexer, syntax tree builder), `syntax_tree` (nodes, printer, traversal), `errors`
(messages for syntax errors), `terms` (run-time values), `compiler` (plans, rules and queries to Python code).
Nothing here does I/O or knows of a mind's state.
"""
