"""A second push simulator: slow, simple, and independent of the kernels.

It integrates the part's velocity from the start of the pusher's path to its end. At every pose shapely finds
where the pusher's points, or its round tips, touch the part or nearly do. The velocity is that of a
consistent mode of these contacts, as in `twin`. The simulator is meant for convex polygons of few vertices,
and shares no code with `planner.mechanics`.
"""

import math

import numpy as np
import shapely
from problems import place
from scipy.integrate import solve_ivp
from twin import Part, rate

CLOSING = 0.004
"""Share of the path over which a gap closes, so that the velocity does not jump at a touch."""
NEAR_MM = 0.02


def push(
    part: Part,
    fingers: np.ndarray,
    centre: np.ndarray,
    angle: float,
    shift: np.ndarray,
    radius: float = 0.0,
) -> np.ndarray:
    """Pushes a part that lies at (0, 0, 0); returns its final pose (3,).

    Args:
        part: the part; its jaws are not used.
        fingers: (K, 2) points of the pusher at the start of the path [mm].
        centre: (2,) point about which the pusher turns [mm].
        angle: turn along the whole path [rad].
        shift: (2,) displacement of the centre along the whole path [mm].
        radius: radius of the round tips at the points [mm].
    """

    def velocity(share: float, q: np.ndarray) -> np.ndarray:
        c, s = math.cos(share * angle), math.sin(share * angle)
        middle = centre + share * shift
        now = (fingers - centre) @ np.array([[c, s], [-s, c]]) + middle
        boundary = shapely.Polygon(place(part.outline, q))
        touched = [each for point in now if (each := _contact(boundary, point, radius)) is not None]
        if not touched:
            return np.zeros(3)
        gap, *places = np.array(touched).T
        px, py = places[:2]
        advance = shift + angle * np.column_stack([middle[1] - py, px - middle[0]])
        return rate(part, q, np.array(places).T, advance, gap / CLOSING)

    steps = {"max_step": CLOSING / 2, "rtol": 1e-3, "atol": 1e-3, "method": "RK23"}
    return solve_ivp(velocity, (0.0, 1.0), np.zeros(3), **steps).y[:, -1]


def _contact(part: shapely.Polygon, point: np.ndarray, radius: float) -> tuple[float, ...] | None:
    """Returns gap, nearest point of the boundary and inward normal for a pusher's point, as five numbers.

    Returns None if the point is not near the part.
    """
    boundary, here = part.exterior, shapely.Point(point)
    touched = np.array(boundary.interpolate(boundary.project(here)).coords[0])
    outside = -1.0 if part.contains(here) else 1.0
    distance = here.distance(boundary)
    if distance > radius + NEAR_MM and outside > 0.0:
        return None
    normal = _inward(part, touched) if distance < 1e-6 else outside * (touched - point) / distance
    return (outside * distance - radius, *touched, *normal)


def _inward(part: shapely.Polygon, point: np.ndarray) -> np.ndarray:
    """The inward normal of the edge nearest to a point on the boundary."""
    corners = shapely.get_coordinates(part.exterior)
    edges = shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1))
    nearest = int(np.argmin(shapely.distance(edges, shapely.Point(point))))
    x, y = corners[nearest + 1] - corners[nearest]
    turn = 1.0 if shapely.is_ccw(part.exterior) else -1.0
    return turn * np.array([-y, x]) / math.hypot(x, y)
