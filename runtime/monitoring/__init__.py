"""Shows a run to people and programs: on the console, as a status, on a live page, to the service manager."""
