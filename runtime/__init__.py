"""The cell controller: reads a decision table and executes it; standard library and msgpack, never numpy."""

VERSION = "0.1.0"  # as in pyproject.toml; importlib.metadata would load 33 modules for it
