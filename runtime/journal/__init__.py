"""The journal of a run: its chain of records, replay, recovery after a crash, export."""
