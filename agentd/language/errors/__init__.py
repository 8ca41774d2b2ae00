"""Messages for syntax errors: what is wrong, where, what was expected, and what to write.

`explain` makes the message; `syntax_errors.txt` is the table of patterns and texts, read by `token_patterns`;
`error_context` says what the parser was in, `lexical` judges characters, `suggestions` finds similar names.
"""
