"""A simulated cell in one thread on a virtual clock."""
