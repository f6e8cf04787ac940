"""Simulated devices that speak the real ones' bytes, and the cell that joins them to a world."""
