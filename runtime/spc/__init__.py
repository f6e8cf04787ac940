"""What the journals of many parts say: is the cell still the one that its table was made for.

Standard library only: a report is made on the cell controller, from journals alone.
"""
