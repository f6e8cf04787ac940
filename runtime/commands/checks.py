"""Checks of `grasp-doctor`: each checks one property of a cell, and yields findings with remedies.

No check moves anything or writes to a device. The checks of a serial port read /dev, /proc and /sys; the
other checks receive opened devices.
"""

import os
import stat
from collections.abc import Callable, Iterator
from enum import Enum
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median, quantiles
from typing import NamedTuple

from drivers.ports import Answered, Arm, Gripper
from runtime.devices.clock import SystemClock
from runtime.shell.plain_text import capital
from runtime.table import Area, Calibration, Limits, Table, misfits

ROOT = Path("/")  # folder of the system's files; tests use a folder of their own
READS = 200
READING_S = 10.0  # time after which slow readings end early
LEAST_READS = 3  # least number of readings, however slow they are
SLOW_MS, JITTER_MS = 12.0, 25.0  # Robotiq's SDK polls at 100 Hz; 16 ms is an untuned FTDI adapter
USUAL_UNIT, USUAL_BAUD = 9, 115200
PSEUDO_TERMINALS = range(136, 144)  # major numbers (Linux, Documentation/admin-guide/devices.txt)


class Verdict(Enum):
    """Grade of a finding; a cell with a bad finding must not run."""

    GOOD = "good"
    WARNING = "warning"
    BAD = "bad"


class Finding(NamedTuple):
    """Result of a check: a grade, a sentence, and a remedy unless the grade is GOOD."""

    verdict: Verdict
    sentence: str
    remedy: str = ""


good, warning, bad = (partial(Finding, verdict) for verdict in Verdict)


def check_port(port: str, root: Path = ROOT) -> Iterator[Finding]:
    """Checks whether a serial port exists, may be opened, and is not open in another process.

    Args:
        port: path of the port.
        root: folder in which `dev` and `proc` are.
    """
    path = Path(port)
    if not path.exists():
        ttys = sorted(map(str, (root / "dev").glob("tty[UA][SC]*")))
        others = ", ".join(ttys) or "none"
        yield bad(
            f"Port {port} does not exist; serial ports here: {others}.",
            "Plug the adapter in, look at `dmesg | tail`, or name one of those ports.",
        )
        return
    if not stat.S_ISCHR(path.stat().st_mode):
        yield bad(f"{port} is no serial port.", "Name a device such as /dev/ttyUSB0.")
        return
    if not os.access(path, os.R_OK | os.W_OK):
        yield bad(
            f"Port {port} exists, but this user may not open it.",
            f"sudo usermod -aG {_group(path)} $USER, then log out and in again.",
        )
        return
    yield good(f"Port {port} exists and may be opened.")
    if os.major(path.stat().st_rdev) in PSEUDO_TERMINALS:
        yield good("It is a pseudo-terminal, as a simulated cell has.")
    holders = list(_holders(path, root / "proc"))
    if holders:
        message = ", ".join(f"{name} (process {pid})" for pid, name in holders)
        yield bad(f"Port {port} is held by {message}.", "Stop it; two masters garble each other.")
    else:
        yield good("Nobody else holds the port.")


def check_latency(port: str, root: Path = ROOT) -> Iterator[Finding]:
    """Checks whether the latency timer of a port's FTDI adapter delays each exchange with the gripper.

    Args:
        port: path of the port.
        root: folder in which `sys` is.
    """
    name = Path(port).resolve().name
    timer = root / "sys/bus/usb-serial/devices" / name / "latency_timer"
    try:
        value = int(timer.read_text())
    except (OSError, ValueError):
        yield good("The adapter has no latency timer that could slow the line down.")
        return
    if value <= 1:
        yield good(f"The adapter's latency timer is {value} ms.")
        return
    yield warning(
        f"The adapter's latency timer is {value} ms; each exchange with the gripper waits for it.",
        f"echo 1 | sudo tee {timer}; for good, a udev rule: "
        'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"',
    )


def check_silence(port: str, scan: Callable[[str], Iterator[Answered]]) -> Iterator[Finding]:
    """Finds out why a Robotiq gripper does not answer at a port.

    The finding says that a device answers at another slave id or baud rate, that the gripper now answers as
    expected (a loose plug), or that nothing answers.

    Args:
        port: path of the port.
        scan: asks at a port for each slave id and baud rate, and yields the answers.
    """
    for heard in scan(port):
        if (heard.unit, heard.baud) == (USUAL_UNIT, USUAL_BAUD):
            yield warning(
                "The gripper answers now; it did not before.",
                "Start again; look for a loose plug if this comes back.",
            )
        else:
            yield bad(
                f"A device answers as slave {heard.unit} at {heard.baud} baud; "
                f"expected is slave {USUAL_UNIT} at {USUAL_BAUD}.",
                "Set slave id and baud rate back with the Robotiq User Interface.",
            )
        return
    yield bad(
        "No slave id from 1 to 16 answers at any baud rate.",
        "Check 24 V (the LED must be lit), A and B not swapped, and that the gripper is not on the robot's "
        "own tool connector.",
    )


def check_gripper(gripper: Gripper) -> Iterator[Finding]:
    """Checks whether the gripper is activated and free of faults."""
    seen = gripper.state()
    if seen.fault:
        problem, _, remedy = seen.fault_text.partition("; ")
        yield bad(
            f"The gripper reports fault {problem}.",
            f"{capital(remedy)}." if remedy else "Remove the cause, then grasp-runtime --activate.",
        )
    elif not seen.activated:
        yield warning(
            "The gripper is not activated.",
            "Clear the space between its fingers and start grasp-runtime with --activate.",
        )
    else:
        yield good(f"The gripper is active and stands at {seen.width_um / 1000:.2f} mm.")


def check_model(gripper: Gripper) -> Iterator[Finding]:
    """Yields a finding that states which model the gripper is taken for; its grade is always GOOD."""
    known = gripper.profile
    stroke_mm, step_mm = known.stroke_um / 1000, known.resolution_um / 1000
    yield good(f"It is taken for a {known.model}: {stroke_mm:g} mm in steps of {step_mm:.2g} mm.")


def failed(device: str, error: Exception, remedy: str) -> Finding:
    """Makes a finding from an error with which a device failed to open or to answer.

    Args:
        device: name of the device for the sentence.
        error: the error. If its message has a semicolon, the text after it is the remedy.
        remedy: the remedy if the message has none.
    """
    problem, _, hint = str(error).partition("; ")
    silent = isinstance(error, ConnectionError | TimeoutError)
    how = "does not answer" if silent else "cannot be opened"
    return bad(f"The {device} {how}: {problem}.", f"{capital(hint)}." if hint else remedy)


def check_rate(gripper: Gripper, clock: SystemClock) -> Iterator[Finding]:
    """Checks how fast and how evenly the gripper can be read, with up to `READS` readings."""
    moments = [clock.now()]
    for _ in range(READS):
        gripper.state()
        moments.append(clock.now())
        if moments[-1] - moments[0] > READING_S and len(moments) > LEAST_READS:
            break
    spent_ms = [1e3 * (later - sooner) for sooner, later in pairwise(moments)]
    middle, late = median(spent_ms), quantiles(spent_ms, n=100)[98]
    rate = 1e3 / max(middle, 1e-3)
    many = f"{len(spent_ms)} readings: {middle:.1f} ms each"
    figures = f"{many}, 99 of 100 within {late:.1f} ms, {rate:.0f} a second."
    if middle > SLOW_MS or late > JITTER_MS:
        yield warning(
            figures,
            f"Up to {SLOW_MS:g} and {JITTER_MS:g} ms are usual: set the latency timer to 1, take load off "
            "this machine, avoid USB hubs.",
        )
    else:
        yield good(figures)


def check_arm(arm: Arm, table: Table | None) -> Iterator[Finding]:
    """Reads the arm's position; if there is a table, checks whether the arm is near the table's work area."""
    x_mm, y_mm, z_mm, _ = arm.pose()
    yield good(f"The arm answers; it stands at ({x_mm:.1f}, {y_mm:.1f}, {z_mm:.1f}) mm.")
    if table is not None and not _is_near(x_mm, y_mm, table.limits):
        yield warning(
            "It stands far outside the table's work area.",
            "Check its work object and tool frames (drivers/abb/README.md), or jog it there first.",
        )


def check_table(table: Table, calibration: Calibration) -> Iterator[Finding]:
    """Checks whether a table fits the widths that a gripper can read.

    Args:
        table: the table.
        calibration: the gripper's calibration, or its nominal widths.
    """
    problems = misfits(table, calibration)
    if problems:
        message = f"The table does not fit this gripper: {problems[0]}."
        yield bad(message, "Recompile or recalibrate.")
        return
    yield good(f"The table fits this gripper: {len(table.nodes)} nodes.")


def _is_near(x_mm: float, y_mm: float, limits: Limits) -> bool:
    area = limits.work_area_um
    room = max(area.x_max - area.x_min, area.y_max - area.y_min)
    wide = Area(area.x_min - room, area.y_min - room, area.x_max + room, area.y_max + room)
    return wide.contains(x_mm, y_mm)


def _group(path: Path) -> str:
    try:
        return path.group()
    except KeyError:
        return "dialout"


def _holders(path: Path, proc: Path) -> Iterator[tuple[int, str]]:
    """Finds the other processes that have a device open, as far as this user may see; yields id and name.

    The process that created a pseudo-terminal, such as a simulated cell, is left out.

    Args:
        path: file of the device.
        proc: the folder /proc.
    """
    wanted = path.stat().st_rdev
    pseudo = os.minor(wanted) if os.major(wanted) in PSEUDO_TERMINALS else None
    for folder in proc.glob("[0-9]*"):
        if int(folder.name) == os.getpid():
            continue
        try:
            opened = any(_rdev(entry) == wanted for entry in (folder / "fd").iterdir())
            if opened and (pseudo is None or not _made(folder, pseudo)):
                yield int(folder.name), (folder / "comm").read_text().strip()
        except OSError:  # gone meanwhile, or not readable for this user
            continue


def _made(folder: Path, pseudo: int) -> bool:
    """Whether a process created a pseudo-terminal: it has the master's end open.

    See fdinfo in Linux, drivers/tty/pty.c.

    Args:
        folder: the process' folder in /proc.
        pseudo: minor number of the pseudo-terminal.
    """
    lines = (entry.read_text().split() for entry in (folder / "fdinfo").iterdir())
    return any(words[-2:] == ["tty-index:", str(pseudo)] for words in lines)


def _rdev(entry: Path) -> int:
    try:
        seen = entry.stat()
    except OSError:
        return -1
    return seen.st_rdev if stat.S_ISCHR(seen.st_mode) else -1
