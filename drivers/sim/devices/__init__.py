"""The simulated devices: gripper with its jaws, arm with its RAPID server."""
