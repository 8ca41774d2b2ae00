"""The router of a board: configuration, admission of links, monitoring of links and of itself."""
