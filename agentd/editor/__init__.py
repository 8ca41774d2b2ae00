"""AgentSpeak in editors and on pages: a Pygments lexer and a TextMate grammar, from the tokens of the language itself.

Nothing that runs agents needs this.
"""
