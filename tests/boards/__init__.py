"""Boards for real: a network namespace for each, with daemons of its own, and links that are cut between them."""
