"""Modbus master, independent of the device."""
