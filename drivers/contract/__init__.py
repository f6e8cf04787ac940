"""Contracts of grippers and arms, as tests for the author of a driver (tools/docs/drivers.md).

```
from drivers.contract.gripper import GripperContract

class TestAcme(GripperContract):
    def make(self): return AcmeRig()
```
"""

import pytest

# So that a failed assertion shows the compared values.
pytest.register_assert_rewrite("drivers.contract.gripper", "drivers.contract.arm")
