"""Drivers: how a bridge talks to a robot, one package per protocol."""
