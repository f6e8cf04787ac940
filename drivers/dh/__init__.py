"""DH-Robotics grippers of the AG and PGC series: Modbus RTU, positions in thousandths of the stroke."""
