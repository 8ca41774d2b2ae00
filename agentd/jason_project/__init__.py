"""Jason's project files (.mas2j): lexer, parser, syntax, and the loader that turns one into agents."""
