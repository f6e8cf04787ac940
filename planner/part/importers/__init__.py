"""Outlines from where parts come from: DXF, SVG, CSV and STL files; `file.read_outline` takes any of them."""
