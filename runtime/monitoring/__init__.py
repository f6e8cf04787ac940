"""Observers of a run: console, status, watchdog, live views."""
