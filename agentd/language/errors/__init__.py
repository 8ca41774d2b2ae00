"""Messages for syntax errors: what is wrong, where, what was expected, and what to write.

`explain` makes the message, by the table of patterns and texts `syntax_errors.txt`;
`error_context` says what the parser was in, `lexical` judges characters, `suggestions` finds similar names.
"""
