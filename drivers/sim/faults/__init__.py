"""Faults of a simulated cell: schedules, and devices that have them."""
