"""What the executor uses besides gripper and arm: clock, locks of devices, auditor, simulated cell."""
