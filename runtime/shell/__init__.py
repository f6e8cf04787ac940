"""Common parts of all commands; standard library only."""
