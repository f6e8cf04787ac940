"""The job: all inputs of a plan. Its file, fields and checks, and copies with replaced values."""
