"""Lets a PLC be the master of the cell: a handshake for each part, and servers for Modbus TCP and OPC UA."""
