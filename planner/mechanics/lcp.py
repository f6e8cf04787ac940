"""The linear complementarity problem (LCP) of the contact step, solved by Lemke's method.

Find z with  w = M z + q,  w >= 0,  z >= 0,  z . w = 0   (Cottle, Pang & Stone 1992, section 4.4).

The contact matrices are copositive. So if the method ends in a ray, no solution exists: the part is held
(paper, IV). Ties in the ratio test are broken lexicographically, so that flush grasps, which are degenerate,
do not cycle.
"""

from planner.arrays import Array, IntArray
from planner.kernel import inlined_kernel, inner_kernel

SOLVED = 0
RAY = 1
PIVOT_LIMIT = 2

PIVOT_TOLERANCE = 1e-8  # A smaller pivot is a rounding error, which would cause huge forces
TIE = 1e-9  # Ratios nearer than this are equal; the lexicographic order decides
PIVOTS_PER_ROW = 50


@inlined_kernel
def _leaving_row(tableau: Array, basis: IntArray, n: int, entering: int) -> int:
    """Chooses the row whose variable leaves the basis when the variable of column `entering` enters it.

    This is the row of the lexicographic minimum ratio; -1 where no entry of the column is positive. The
    artificial variable (column 2n) leaves as soon as possible, which ends the method.
    """
    best = -1
    for row in range(n):
        pivot = tableau[row, entering]
        if pivot <= PIVOT_TOLERANCE:
            continue
        if best < 0:
            best = row
            continue
        best_pivot = tableau[best, entering]
        difference = tableau[row, 2 * n + 1] / pivot - tableau[best, 2 * n + 1] / best_pivot
        if abs(difference) <= TIE:
            if basis[best] == 2 * n:
                continue
            if basis[row] == 2 * n:
                best = row
                continue
            difference = 0.0
            for column in range(n):
                difference = tableau[row, column] / pivot - tableau[best, column] / best_pivot
                if abs(difference) > TIE:
                    break
        if difference < 0.0:
            best = row
    return best


@inlined_kernel
def _pivot(tableau: Array, n: int, row: int, column: int) -> None:
    """Eliminates `column` from all rows but `row`, by Gauss-Jordan elimination in place."""
    width = 2 * n + 2
    scale = 1.0 / tableau[row, column]
    for j in range(width):
        tableau[row, j] *= scale
    tableau[row, column] = 1.0
    for i in range(n):
        if i == row:
            continue
        factor = tableau[i, column]
        if factor == 0.0:
            continue
        for j in range(width):
            tableau[i, j] -= factor * tableau[row, j]
        tableau[i, column] = 0.0


@inner_kernel
def lemke(M: Array, q: Array, n: int, tableau: Array, basis: IntArray, z: Array) -> int:
    """Solves w = M z + q, w >= 0, z >= 0, z . w = 0; returns `SOLVED`, `RAY` (no solution) or `PIVOT_LIMIT`.

    Args:
        M: shape (>= n, >= n), copositive; the leading (n, n) block is read.
        q: shape (>= n,); the first n entries are read.
        n: order of the problem.
        tableau: workspace (>= n, >= 2 n + 2). Columns: w (n), z (n), the artificial z0, the right-hand side.
        basis: integer workspace (>= n,): the variable basic in each row.
        z: shape (>= n,), receives the solution, or zeros if there is none.
    """
    start = 0
    for i in range(n):
        z[i] = 0.0
        if q[i] <= q[start]:  # the last of equals: so all rows are lexicographically positive
            start = i
    if n == 0 or q[start] >= 0.0:
        return SOLVED
    for i in range(n):
        for j in range(n):
            tableau[i, j] = 0.0
            tableau[i, n + j] = -M[i, j]
        tableau[i, i] = 1.0
        tableau[i, 2 * n] = -1.0
        tableau[i, 2 * n + 1] = q[i]
        basis[i] = i
    _pivot(tableau, n, start, 2 * n)
    entering = start + n
    basis[start] = 2 * n
    for _ in range(PIVOTS_PER_ROW * n + 20):
        row = _leaving_row(tableau, basis, n, entering)
        if row < 0:
            return RAY
        leaving = basis[row]
        _pivot(tableau, n, row, entering)
        basis[row] = entering
        if leaving == 2 * n:
            for i in range(n):
                if basis[i] >= n:
                    z[basis[i] - n] = max(tableau[i, 2 * n + 1], 0.0)
            return SOLVED
        entering = leaving + n if leaving < n else leaving - n
    return PIVOT_LIMIT


@inner_kernel
def residual(M: Array, q: Array, z: Array, n: int) -> float:
    """Largest violation of the conditions w >= 0, z >= 0 and z . w = 0 by a solution z of the LCP.

    The violation of z . w = 0 is the largest of min(|z_i|, |w_i|).
    """
    worst = 0.0
    for i in range(n):
        w = q[i]
        for j in range(n):
            w += M[i, j] * z[j]
        gap = min(abs(w), abs(z[i]))
        worst = max(worst, -w, -z[i], gap)
    return worst
