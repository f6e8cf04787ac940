"""The job: what a plan depends on. Its file, fields and checks, and copies with values replaced."""
