"""What every gripper must do, of SCHUNK's on a serial line (drivers/ports.py)."""

import pytest
from schunk_rigs import SchunkRig

from drivers.contract.gripper import GripperContract


class TestSchunk(GripperContract):
    """An EGU and an EGK."""

    @pytest.fixture(params=["schunk-egu", "schunk-egk"])
    def rig(self, request):
        result = SchunkRig(request.param)
        yield result
        result.close()
