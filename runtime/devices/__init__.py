"""What the executor works with: clock, locks, the auditor, the simulated cell."""
