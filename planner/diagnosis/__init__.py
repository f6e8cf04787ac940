"""Diagnosis: what limits a plan, and what to change."""
