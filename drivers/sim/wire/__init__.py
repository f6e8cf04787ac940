"""Bytes between hosts and simulated devices: ports, Modbus frames, and a line with timing and faults."""
