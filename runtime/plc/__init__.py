"""A PLC as the master of the cell: its handshake, and servers for Modbus TCP and OPC UA."""
