"""The execution of a decision table: place, squeeze, read, decide, release, deliver."""
