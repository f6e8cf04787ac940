"""The job: everything that a plan depends on. Its file, its fields and checks, and copies with values replaced."""
