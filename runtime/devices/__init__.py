"""What the executor works with: Protocols, clock, locks, the auditor, the simulated cell."""
