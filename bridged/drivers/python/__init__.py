"""The Python driver: functions of installed plug-ins are the robot's sensors and actuators (docs/guides/drivers.md)."""
