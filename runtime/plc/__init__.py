"""A PLC as the master of the cell: its handshake, its registers and the Modbus TCP server."""
