"""Manifests and messages in the format of the paper (INI files, ROS names, text values)."""
