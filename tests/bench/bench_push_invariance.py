"""Measures how far the ends of pushes by hand depend on how the pushes are computed.

    python tests/bench/bench_push_invariance.py [--pushes 3000]

This is the property test at length. Random pushes of seven shapes are computed in several variants: as they
are, in two pushes, with other steps, with the vertices in another order, with more vertices on the edges, and
from starts that differ by 1e-9 mm. Prints the share of pushes that ends more than 0.5 mm or 0.02 rad
elsewhere, the largest overlap of part and fingers, and the time of a push. Writes
`results/push_invariance.json`. Not part of `tools/check`.
"""

import time

import harness
import numpy as np
from problems import simulator
from push_study import SHAPES, WAY_MM, pushed, scattered, studied

RESULTS = harness.Kept("push_invariance")


def microseconds(outline: np.ndarray, n: int) -> float:
    """Mean processor time of n random pushes [us]."""
    part, (poses, opening) = simulator(outline), scattered(outline, n, 1)
    start = time.process_time()
    pushed(part, poses, opening, WAY_MM, 1)
    return 1e6 * (time.process_time() - start) / n


def main() -> None:
    """Compares the variants for each shape, prints the figures and writes them."""
    parser = harness.parser(__doc__)
    parser.add_argument("--pushes", type=int, default=3000, help="of each shape")
    options = parser.parse_args()
    rows = {}
    for name, shape in SHAPES.items():
        outline = shape()
        rows[name] = studied(outline, options.pushes, 1)
        rows[name]["push_us"] = microseconds(outline, options.pushes)
        harness.show({"shape": name, **rows[name]})
    RESULTS.write({"pushes": options.pushes, "shapes": rows})


if __name__ == "__main__":
    main()
