"""Bytes between host and simulated gripper: Modbus RTU on a line with its timing."""
