"""The cell controller: reads a decision table and executes it.

The package never imports numpy. A run without PLC and signatures needs only msgpack besides the standard
library; the drivers of the devices may need more.
"""

VERSION = "0.1.0"  # as in pyproject.toml; importlib.metadata would load 33 modules for it
