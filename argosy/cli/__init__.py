"""What all commands share: arguments, the bus as an operator, the journal, remedies for notes, optional packages."""
