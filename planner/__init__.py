"""The offline planner: compiles a job file to a decision table. Needs the `planner` extra."""
