"""Robotiq 2F and Hand-E grippers: registers as data, device logic, Modbus, CANopen and URCap transports."""
