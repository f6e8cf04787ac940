"""Drivers of ABB arms (IRC5, OmniCore), and what other makes share: poses, checks of reach, a base class."""
