"""The router of a board: configuration, admission of other machines, monitoring of links and of the board itself."""
