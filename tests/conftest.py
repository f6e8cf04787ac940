"""Lets every test import the shared problem libraries in this folder by name."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
