"""SCHUNK EGU and EGK grippers: parameters as data, device logic, Modbus RTU."""
