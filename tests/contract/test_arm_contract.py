"""The contract of every arm (drivers/ports.py), tested on each make of `arm_rigs`."""

import pytest
from arm_rigs import RIGS

from drivers.abb import arm as abb
from drivers.abb import rws
from drivers.contract.arm import ArmContract
from drivers.ur import rtde


class TestArms(ArmContract):
    """The contract, on every make."""

    @pytest.fixture(params=RIGS)
    def rig(self, request, monkeypatch):
        result = RIGS[request.param]()
        silence = result.silence

        def soon_noticed():
            for module in (rws, rtde):
                monkeypatch.setattr(module, "ANSWER_S", 0.1)
            monkeypatch.setattr(abb, "STARVED_S", 0.1)
            silence()

        result.silence = soon_noticed
        yield result
        result.close()
