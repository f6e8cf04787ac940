"""Importers of outlines from DXF, SVG, CSV, STL and KiCad files; `file.read_outline` reads any of them."""
