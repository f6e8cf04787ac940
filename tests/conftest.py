"""Lets every test import the shared problem libraries in this folder by name."""

import signal
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

# A shell without job control ignores Ctrl-C in what it starts with `&`, and nohup ignores SIGHUP; processes
# hand that down. The tests send both to themselves and to the commands they start.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
