"""What every arm must do (drivers/ports.py), against each make of `arm_rigs`."""

import pytest
from arm_rigs import RIGS

from drivers.contract.arm import ArmContract


class TestArms(ArmContract):
    """Every make."""

    @pytest.fixture(params=RIGS)
    def rig(self, request):
        result = RIGS[request.param]()
        yield result
        result.close()
