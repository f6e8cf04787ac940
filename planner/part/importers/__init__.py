"""Outlines from DXF, SVG, CSV, STL and KiCad files; `file.read_outline` takes any of them."""
