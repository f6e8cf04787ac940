"""The devices of a cell: gripper, arm, and their simulators, each a driver like any other.

`connect` opens them by port name; nothing else here needs to be imported to run a cell.
"""
