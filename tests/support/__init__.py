"""Doubles and helpers that the tests of several floors share."""
