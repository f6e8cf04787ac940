"""Drivers of ABB arms (IRC5, OmniCore), and what they share with UR arms: poses, checks, a base class."""
