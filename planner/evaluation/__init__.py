"""Evaluation of a table: trials in a world, and statistics of them (paper VII)."""
