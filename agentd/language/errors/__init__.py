"""Messages for syntax errors: what is wrong, where, what was expected, and what to write.

`explain` makes the message, by the table of patterns and texts `syntax_errors.txt`;
`error_context` finds the part of a program that a token is in, `lexical` explains characters.
"""
