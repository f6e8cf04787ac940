"""Quasi-static mechanics of a part pushed by fingers on a table (paper section IV)."""
