"""Refit: the posterior of a cell's constant errors, given its journals."""
