"""A PLC as the master of the cell: its handshake, and the servers for Modbus TCP and OPC UA."""
