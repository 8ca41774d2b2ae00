"""Drivers: how the bridge talks to robots.

A driver is a module with the functions of `bridged.drivers.api.DriverKind`. `registry` finds it by its name in a
manifest, `argument_check` checks the arguments of its actions, `simple` is a start for drivers of simple robots.
"""
