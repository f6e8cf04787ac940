"""Accepts a cell: judges a run-off after any number of parts, and studies the squeeze as a gauge.

A run-off is a series of audited parts in a new cell. Its results are printed on the run-off sheet.
"""
