"""Moves a gripper with SCHUNK's own software, the class BKSModule of bkstools; prints the results as JSON.

The argument is the gripper's port. test_bkstools runs this script on a simulated gripper.
"""

import json
import sys

from bkstools.bks_lib.bks_module import BKSModule

module = BKSModule(sys.argv[1], repeater_timeout=20.0)
module.wait_command_received_timeout = 20.0  # enough for a busy machine
results = {"error at start": module.err_code, "ready": module.MakeReady()}


def noted(name):
    status = module.plc_sync_input[0]
    results[name] = {
        "mm": round(module.actual_pos, 3),
        "gripped": bool(status & module.sw_gripped),
        "success": bool(status & module.sw_success),
        "error": bool(status & module.sw_error),
    }


long = {"wait_command_successfully_processed_timeout": 20.0}
module.move_to_absolute_position(80_000, 110_000, **long)
noted("absolute")
module.move_to_absolute_position(60_000, 110_000, **long)
noted("absolute again")
module.move_to_relative_position(10_000, 110_000, **long)
noted("relative")
module.grip_workpiece(BKSModule.grip_from_outside, 0, 100, **long)
noted("grip")
module.release_workpiece(**long)
noted("release")
from_outside = BKSModule.grip_from_outside
module.grip_workpiece_with_expected_position(from_outside, 41_000, 25_000, 50, **long)
noted("grip at a width")
results["expected"] = {"max_pos": module.max_pos, "max_vel": module.max_vel}
print(json.dumps(results))
