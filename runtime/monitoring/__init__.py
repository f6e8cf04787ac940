"""Who watches a run: console, status, watchdog, live views."""
