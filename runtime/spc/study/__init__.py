"""Acceptance of a cell: studies of the squeeze as a gauge, a sequential verdict, the run-off sheet."""
