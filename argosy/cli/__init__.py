"""Shared by all commands: arguments, the bus as an operator, the journal, remedies for notes, optional packages."""
