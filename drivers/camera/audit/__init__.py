"""Audit: judges by a picture whether a part lies at its predicted pose."""
