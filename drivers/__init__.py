"""Drivers of a cell's devices (gripper, arm and their simulators); `connect` opens them by name."""
