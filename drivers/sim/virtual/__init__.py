"""A simulated cell in one thread, on a clock that advances only when somebody waits."""
