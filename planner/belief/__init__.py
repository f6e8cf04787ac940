"""What is known of the part: particles, the goal's metric, what the encoder shows, what a squeeze changes."""
