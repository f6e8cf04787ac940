"""The cell controller: reads a decision table and executes it.

It never imports numpy. A run without PLC and signatures needs only msgpack besides the standard library; its
drivers may need more.
"""

VERSION = "0.1.0"  # as in pyproject.toml; importlib.metadata would load 33 modules for it
