"""The journal of a run: chain of records, replay, export."""
