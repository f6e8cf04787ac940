"""Statistical process control from journals: whether the cell still matches its table.

Reports are made on the cell controller, from journals alone, and so do without numpy.
"""
