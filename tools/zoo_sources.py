"""Outlines of real components, read from installed packages; none is copied here.

Debian's `kicad-footprints` (CC-BY-SA 4.0) has bodies on the fabrication layer of footprints. PyPI's
`bd-warehouse` (Apache-2.0) has tables of ISO and DIN parts, whose outlines are drawn here as they lie on a
table.
"""

import csv
import hashlib
import math
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import shapely

from planner.part.importers.file import read_outline
from planner.part.importers.pieces import Options
from planner.part.outline import canonical, simplified
from runtime.shell.errors import ExpectedError

FOOTPRINTS = Path("/usr/share/kicad/footprints")
HOW = "apt-get install --no-install-recommends kicad-footprints; pip install --no-deps bd-warehouse"
SMALLEST_MM, LARGEST_MM = 8.0, 80.0
TOLERANCE_MM = 0.05
SAME_MM = 0.1  # outlines that differ by less, in their sides and along their boundary, are the same
KEPT_ASIDE = 10  # one outline in so many, by the hash of its name, is reserved for a final test

Outlines = dict[str, np.ndarray]


def outlines() -> Outlines:
    """All distinct outlines (n, 2) [mm] by name, without rectangles and discs; none without the packages."""
    result, seen = {}, set()
    for name, outline in (*footprints(), *screws(), *rings(), *keys()):
        size = np.ptp(outline, axis=0)
        area = shapely.Polygon(outline).area
        key = (tuple(np.rint(np.sort(size) / SAME_MM)), round(math.sqrt(area) / SAME_MM))
        if SMALLEST_MM <= size.max() <= LARGEST_MM and not trivial(outline) and key not in seen:
            seen.add(key)
            result[name] = outline
    return result


def kept_aside(name: str) -> bool:
    """Whether an outline is reserved for a final test."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big") % KEPT_ASIDE == 0


def trivial(outline: np.ndarray) -> bool:
    """Whether an outline is a rectangle or a circle, to within about `SAME_MM` along its boundary."""
    part = shapely.Polygon(outline)
    box, (x, y) = part.minimum_rotated_rectangle, part.centroid.coords[0]
    disc = shapely.Point(x, y).buffer(math.sqrt(part.area / math.pi), quad_segs=64)
    rim = SAME_MM * part.length
    return any(part.symmetric_difference(shape).area < rim for shape in (box, disc))


def footprints() -> Iterator[tuple[str, np.ndarray]]:
    """Yields the name and the largest body contour of every footprint that has a valid one."""
    for path in sorted(FOOTPRINTS.glob("*.pretty/*.kicad_mod")):
        try:
            read = read_outline(path, Options(contour=1, tolerance_mm=TOLERANCE_MM))
        except ExpectedError:  # no body, or one that crosses itself
            continue
        yield f"{path.parent.stem}/{path.stem}", read.outline_mm


def screws() -> Iterator[tuple[str, np.ndarray]]:
    """Yields name and outline of ISO 4014 hexagon head screws, lying on a flat of the head, from above."""
    for row in table("hex_head_parameters.csv"):
        if row["Size"].startswith("M") and row["iso4014:s"]:
            diameter = float(row["Size"][1:].split("-")[0])
            head, corners = float(row["iso4014:k"]), float(row["iso4014:s"]) / math.cos(math.pi / 6)
            for length in (3.0 * diameter, 5.0 * diameter):
                shank = shapely.box(0.0, -0.5 * diameter, length, 0.5 * diameter)
                screw = shank.union(shapely.box(-head, -0.5 * corners, 0.0, 0.5 * corners))
                yield f"iso4014/M{diameter:g}x{length:g}", outline_of(screw)


def rings() -> Iterator[tuple[str, np.ndarray]]:
    """Yields name and outline of DIN 471 retaining rings, with eccentric outer edge and lugs at the gap."""
    for row in table("din471.csv"):
        inner = 0.5 * float(row["d3"])
        lug, width, hole = (float(row[key]) for key in ("a", "b", "d5"))
        ring = shapely.Point(0.0, -width / 4).buffer(inner + 0.75 * width, quad_segs=32)
        for side in (-1.0, 1.0):
            near, far = sorted((0.5 * side * hole, 2.5 * side * hole))
            ring = ring.union(shapely.box(near, 0.5 * inner, far, inner + lug))
        ring = ring.difference(shapely.Point(0.0, 0.0).buffer(inner, quad_segs=32))
        ring = ring.difference(shapely.box(-hole / 2, 0.0, hole / 2, 2.0 * inner + lug))
        yield f"din471/{float(row['d1']):g}", outline_of(ring)


def keys() -> Iterator[tuple[str, np.ndarray]]:
    """Yields name and outline of DIN 6885 A parallel keys: round ends, four times as long as wide."""
    for row in table("shaft_key_parameters.csv"):
        width = float(row["din6885:b"])
        middle = shapely.LineString([[-1.5 * width, 0.0], [1.5 * width, 0.0]])
        yield f"din6885/{width:g}", outline_of(middle.buffer(width / 2, quad_segs=16))


def table(name: str) -> list[dict[str, str]]:
    """The rows of a table of bd-warehouse; none if the package is not installed."""
    spec = find_spec("bd_warehouse")
    if spec is None or not spec.submodule_search_locations:
        return []
    path = Path(spec.submodule_search_locations[0]) / "data" / name
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def outline_of(shape: shapely.Polygon) -> np.ndarray:
    """Outer boundary of a drawn part, simplified and in the canonical form of jobs."""
    largest = max(shapely.get_parts(shape), key=shapely.area)
    drawn = canonical(shapely.get_coordinates(largest.exterior)[:-1]).outline_mm
    return canonical(simplified(drawn, TOLERANCE_MM)).outline_mm
