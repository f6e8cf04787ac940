"""Simulated devices with the protocols of the real ones, and the cell that joins them to a world."""
