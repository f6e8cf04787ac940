"""Robotiq 2F and Hand-E grippers: registers as data, device logic, links over Modbus, CANopen and URCap."""
