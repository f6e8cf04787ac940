"""What limits a plan and its models, and what to change."""
