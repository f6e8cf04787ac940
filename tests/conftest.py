"""What every test needs of its process."""

import signal

# A shell without job control ignores Ctrl-C in what it starts with `&`, and processes hand that down; the
# tests send Ctrl-C to the commands they start.
signal.signal(signal.SIGINT, signal.default_int_handler)
