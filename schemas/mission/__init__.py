"""Missions: the model of a mission file, access rules and mail rights that follow from it."""
