"""Devices of the executor: clock, locks, auditor, simulated cell."""
