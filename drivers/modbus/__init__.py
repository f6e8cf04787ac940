"""Modbus as a master speaks it, whatever the device behind it."""
