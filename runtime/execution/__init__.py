"""The execution of a decision table: place, squeeze, read, decide, release, deliver; recovery after a crash."""
