"""Judging a table: its trials in a world, and what can be read from them (paper VII)."""
