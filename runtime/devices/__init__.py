"""What the executor works with, as Protocols: devices, clock, locks, the auditor, the simulated cell."""
