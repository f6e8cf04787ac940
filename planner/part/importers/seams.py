"""Interprets seams: lines inside a contour that two of its faces share, such as bend lines."""

from typing import NamedTuple

import numpy as np
import shapely

from planner.arrays import Array
from planner.part.importers import noding
from planner.part.importers.pieces import place

LISTED = 6  # most seams that a note describes


class Drawn(NamedTuple):
    """Lines of a drawing that may bound a contour, relative to a local origin."""

    lines: list[Array]  # each (n, 2) [mm]; a ring ends where it begins
    layers: list[str]  # layer of each line; "" in formats without layers
    origin: Array  # (2,) the local origin in the drawing [mm]
    tree: shapely.STRtree  # spatial index of the lines


class Meaning(NamedTuple):
    """Meaning of the seams of a region, as texts for people; "" where there is nothing to say."""

    note: str = ""  # the faces that were joined, and the lines between them
    ambiguity: str = ""  # why the outline may be another contour, and what to do


def meaning(region: noding.Region, loose: list[Array], drawn: Drawn, join_mm: float) -> Meaning:
    """Interprets the seams of a region; `loose` are the lines that bound no face.

    A region is ambiguous in three cases. Closed contours overlap in it. A line of its boundary continues
    beyond it, like the extension line of a dimension. Or the lines of one layer alone bound another region,
    while no layer alone bounds this one.
    """
    if not region.seams:
        return Meaning()
    named = [_named(seam, drawn) for seam in region.seams[:LISTED]]
    more = len(region.seams) - LISTED
    what = "line" if len(region.seams) == 1 else "lines"
    lines = "; ".join(named) + (f"; and {more} more" if more > 0 else "")
    remedy = "leave out of the drawing what is no outline"
    if any(drawn.layers):
        remedy = "choose the outline's layer with --layer, or leave out what is no outline"
    joined = f"faces that share the {what} {lines} are one contour"
    note = f"{joined}; if they are not one part, {remedy}"
    loops = [seam for seam in region.seams if np.array_equal(seam[0], seam[-1])]
    ambiguity = ""
    if loops:
        cross = place(loops[0][0] + drawn.origin)
        ambiguity = f"closed contours overlap near {cross} mm; draw the outline as one, or {remedy}"
    elif (beyond := noding.overrun(region, loose, drawn.tree)) is not None:
        line = _named(drawn.lines[beyond], drawn)
        ambiguity = f"the line {line} bounds the contour and goes on beyond it; {remedy}"
    elif layer := _differing_layer(region, drawn, join_mm):
        other = f"another one with the {what} {lines}"
        ambiguity = f"layer {layer} bounds one contour alone, {other}; {remedy}"
    return Meaning(note, ambiguity)


def _named(points: Array, drawn: Drawn) -> str:
    """Describes a line (n, 2) for people: its two ends and its layers."""
    ends = " to ".join(place(end + drawn.origin) for end in sorted(points[[0, -1]].tolist()))
    near = noding.along([shapely.LineString(points)], drawn.tree)
    layers = {drawn.layers[k] for k in near} - {""}
    return f"from {ends} mm" + (f" (layer {', '.join(sorted(layers))})" if layers else "")


def _differing_layer(region: noding.Region, drawn: Drawn, join_mm: float) -> str:
    """Returns a layer whose lines alone bound a region other than this one.

    Returns "" if there is no such layer, or if the lines of some layer alone bound this region.
    """
    face = noding.face(region.ring)
    near = drawn.tree.query(face, "dwithin", distance=join_mm)
    layers = sorted({drawn.layers[k] for k in near})
    differing = ""
    for layer in layers if len(layers) > 1 else ():
        lines = [drawn.lines[k] for k in near if drawn.layers[k] == layer]
        bounded = noding.regions(lines, join_mm).regions
        if not bounded:
            continue
        whole = shapely.union_all([noding.face(each.ring) for each in bounded])
        apart = shapely.symmetric_difference(face, whole)
        if apart.area <= join_mm * face.length:
            return ""
        differing = layer
    return differing
