"""Statistical process control: shows from journals whether a cell still behaves as its table predicts.

Nothing here imports numpy, since reports are made on the cell controller, which has no numpy.
"""
