"""The small table for any gripper."""

from dataclasses import replace

from sample_tables import small_table

from runtime.table import GripperSpec, Table, profile_of

FORCE_N = 40.0


def table_for(model: str) -> Table:
    """Two squeezes of a rectangle by a gripper that opens fully and presses with 40 N, or its least."""
    table, profile = small_table(), profile_of(model)
    force_mn = round(1000 * max(FORCE_N, profile.force_n[0]))
    squeezes = (node.squeeze for node in table.nodes)
    changed = (each._replace(opening_um=profile.stroke_um, force_mn=force_mn) for each in squeezes)
    nodes = (node._replace(squeeze=each) for node, each in zip(table.nodes, changed, strict=True))
    gripper = table.gripper
    gripper = GripperSpec.of(profile, gripper.finger_length_um, gripper.finger_width_um)
    limits = replace(table.limits, max_force_mn=max(table.limits.max_force_mn, force_mn))
    return replace(table, gripper=gripper, limits=limits, nodes=tuple(nodes))
