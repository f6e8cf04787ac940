"""The devices of a cell, gripper, arm and their simulators, each a driver; `connect` opens them by name."""
