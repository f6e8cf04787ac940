"""The small table for a SCHUNK EGU."""

from dataclasses import replace

from sample_tables import small_table

from runtime.table import GripperSpec, Table, profile_of


def egu_table() -> Table:
    """Two squeezes of a rectangle, by fingers that open to 120 mm and press with the least force."""
    table, profile = small_table(), profile_of("schunk-egu")
    nodes = tuple(
        node._replace(
            squeeze=node.squeeze._replace(opening_um=60_000, speed_um_s=20_000, force_mn=325_000)
        )
        for node in table.nodes
    )
    return replace(
        table,
        gripper=GripperSpec.of(profile, 27_500, 9_500),
        limits=replace(table.limits, max_force_mn=650_000),
        nodes=nodes,
    )
