"""Universal Robots arms: RTDE to read, programs of our own in URScript to move."""
