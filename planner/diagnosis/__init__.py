"""What limits a plan, and what to change."""
