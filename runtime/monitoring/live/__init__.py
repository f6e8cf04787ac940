"""What people see of a run while it runs, in a terminal or a browser; loaded only when it is asked for."""
