"""Modbus as a master speaks it, whatever the device: frames, and transactions with deadlines."""
