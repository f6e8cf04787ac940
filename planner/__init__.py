"""The offline planner: a job file in, a decision table out. For workstations; needs the `planner` extra."""
