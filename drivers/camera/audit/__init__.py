"""The audit: judges predicted poses by a picture."""
