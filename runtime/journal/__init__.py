"""The journal of a run: its chain of records, replay, export."""
