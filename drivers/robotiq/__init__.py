"""Robotiq 2F-85 and C-85 adaptive grippers: registers as data, device logic, Modbus transports."""
