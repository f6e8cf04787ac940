"""Identification of a part's limit surface from pushes."""
