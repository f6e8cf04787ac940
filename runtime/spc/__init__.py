"""Statistical process control from journals: whether the cell still matches its table.

Standard library only: reports are made on the cell controller, from journals alone.
"""
