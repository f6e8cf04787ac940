"""Traversal of a table by a part: decisions, requests and results, without devices, files or clocks."""
