"""Universal Robots arms: RTDE to read, generated URScript programs to move."""
