"""Execution of a decision table: place, squeeze, read, release, deliver; recovery after a crash."""
