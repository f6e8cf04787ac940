"""The command `grasp-runtime`: runs parts by a table, checks the table, or puts down a held part."""

import argparse
import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers.ports import Drivers, Report
from runtime.commands.arguments import SIMULATED_CAMERA
from runtime.commands.cell import Devices, connect
from runtime.commands.options import check_usage, views
from runtime.commands.recipe import Recipe, prepare
from runtime.devices.audit import AuditProcess
from runtime.devices.clock import SystemClock
from runtime.devices.lock import PortLock
from runtime.errors import BrokenRunError
from runtime.execution import carry, crash, dry_run, held, session
from runtime.execution.executor import Cell
from runtime.execution.hand import LEVEL_MM
from runtime.execution.safety import needs_activation, ready_gripper
from runtime.journal import files
from runtime.journal import installed as log
from runtime.journal.chain import Incidents, Journal
from runtime.journal.replay import Replay
from runtime.monitoring.monitor import Monitor
from runtime.shell import interrupts
from runtime.shell.command import say
from runtime.shell.errors import UsageError
from runtime.table import Table

if TYPE_CHECKING:
    from runtime.commands.plc import PlcRun


def run(arguments: argparse.Namespace, drivers: Drivers) -> int:
    """Does what the command line asks for: a run of parts, or an option in its stead, such as `--check`.

    Args:
        arguments: the command line, parsed by `arguments.parser`.
        drivers: opens the devices.

    Returns:
        The exit code: after a run, that of the worst part.

    Raises:
        Exception: any error of this package or of a device; each has its `exit_code`.
    """
    check_usage(arguments)
    recipe = prepare(arguments, arguments.trees[0])
    goal = recipe.loaded.table.goal
    if arguments.tips not in (None, "straight") and recipe.options.handling.arc is None:
        recipe.console.note(
            f"--tips {arguments.tips} moves nothing here: you keep the tips at their height above the table"
        )
    if arguments.audit is not None and not goal.identify:
        raise UsageError("--audit judges which part it is, too, which this goal leaves open")
    with ExitStack() as stack:
        asked = _Asked(arguments, recipe, drivers, stack)
        if arguments.check:
            return asked.check()
        if arguments.serve is not None:
            return asked.serve()
        return asked.dry_run() if arguments.dry_run else asked.execute()


@dataclass(frozen=True, slots=True)
class _Asked:
    """One call of `grasp-runtime`: its methods do what the arguments ask for."""

    arguments: argparse.Namespace
    recipe: Recipe  # the table, the first if there are several
    drivers: Drivers
    stack: ExitStack  # closes everything that the call opens

    def execute(self) -> int:
        """Runs the parts, or puts down what the fingers hold; returns the exit code.

        First looks in the journal for a run that broke off, connects to the devices, and makes all checks
        that may refuse the run. Only then the journal records that the run begins.
        """
        arguments, table = self.arguments, self.recipe.loaded.table
        clock = SystemClock(arguments.time_scale)
        plc = None if arguments.plc is None else self._plc()
        recipes = (self.recipe,) if plc is None else plc.recipes
        # The live page is opened first, since its address may be refused. It closes last, so that it shows
        # the run to its end.
        monitor = self.stack.enter_context(self._monitor() if plc is None else plc.monitor)
        journal, begun = self._look_back(clock)
        incidents = Incidents()
        devices = self._connect(incidents.record)
        for recipe in recipes:
            delivery, middle_mm = recipe.options.delivery, recipe.options.handling.middle_mm
            carry.check(delivery, recipe.loaded.table, devices.arm, middle_mm)
        # Checked before the run is recorded: a refused run leaves no record and no new file.
        if begun is None or begun.part is None:
            holds = self._holds(devices, journal)
            if arguments.put_down and holds is None:
                low_mm = devices.arm.pose()[2]
                stands = f"; the arm stands {low_mm:.1f} mm high, where it was"
                return self._say_put_down(None, stands if self._is_low(low_mm) else "")
        auditor = self._auditor(devices)
        journal = journal or self._journal(clock)
        gripper, arm, scene = devices.gripper, devices.arm, devices.scene
        cell = Cell(gripper, arm, devices.clock or clock, journal, auditor, scene)
        self._begin(journal, begun, monitor, recipes)
        incidents.hand_over(journal)
        if arguments.put_down:
            return self._say_put_down(session.put_down(table, cell, self.recipe.options))
        if plc is not None:
            return plc.run(cell)
        tally = session.run_journalled(table, cell, monitor, self.recipe.options, begun)
        monitor.summary(tally, arguments.journal)
        return tally.exit_code

    def _plc(self) -> "PlcRun":
        """Prepares a run for a PLC: loads the other tables, and reserves the address of `--plc`."""
        from runtime.commands import plc  # with a server, which no other run has to load

        arguments = self.arguments
        others = (prepare(arguments, tree) for tree in arguments.trees[1:])
        return plc.opened(arguments, (self.recipe, *others), views(arguments), self.stack)

    def serve(self) -> int:
        """Answers a robot that squeezes parts itself, and records this as a run; returns the exit code."""
        from runtime.commands import serve  # with a server, which no other run has to load
        from runtime.execution.asked import AskedParts, check_asked
        from runtime.monitoring.live.server import Address, listening

        arguments, table, clock = self.arguments, self.recipe.loaded.table, SystemClock()
        check_asked(table)
        address = serve.check(arguments)
        monitor = self.stack.enter_context(self._monitor())
        listener = self.stack.enter_context(listening(address, "--serve"))
        journal = self._look_back(clock)[0] or self._journal(clock)
        place = Address(address.host, listener.getsockname()[1])
        self.recipe.console.note(f"a robot may ask at tcp://{place}")
        self._begin(journal, None, monitor, (self.recipe,))
        with session.ending(journal) as tally:
            name, options = self.recipe.loaded.digest, self.recipe.options
            parts = AskedParts(table, name, journal, clock, monitor, tally, options)
            serve.RobotServer(listener, parts, clock).serve()
        monitor.summary(tally, arguments.journal)
        return tally.exit_code

    def check(self) -> int:
        """Prints what was checked of the table; with a port, also the gripper's present width; returns 0.

        Moves nothing. A table that does not fit has been refused before.
        """
        arguments, table, console = self.arguments, self.recipe.loaded.table, self.recipe.console
        record: dict[str, object] = {"nodes": len(table.nodes), "gripper": None}
        origin = arguments.calibration or "its nominal widths"
        console.note(f"the table fits the gripper: {len(table.nodes)} nodes, by {origin}")
        console.note(_believed(table))
        if self.recipe.options.delivery is not None:
            console.note(
                "the part can be delivered from every leaf, as far as areas tell; --dry-run asks the arm"
            )
        if arguments.port is not None:
            self.stack.enter_context(PortLock(arguments.port))
            gripper = self.drivers.gripper(arguments.port, table.gripper.profile, read_only=True)
            self.stack.callback(gripper.close)
            reading_um = gripper.state().width_um
            width_mm = self.recipe.options.handling.widths(table).width_um(reading_um) / 1000
            console.note(f"the gripper stands at {width_mm:.2f} mm")
            record["gripper"] = {"reading_mm": reading_um / 1000, "width_mm": width_mm}
        if arguments.json:
            say(json.dumps(record))
        return 0

    def dry_run(self) -> int:
        """Prints what a run would send to the devices; returns 0. The links to the devices cannot write."""
        devices, recipe = self._connect(Incidents().record), self.recipe
        table, options = recipe.loaded.table, recipe.options
        lines = list(dry_run.tell(table, devices.gripper, devices.arm, options))
        if self.arguments.json:
            say(json.dumps({"sentences": lines}))
        else:
            for sentence in lines:
                recipe.console.note(sentence)
        recipe.console.note(
            "dry run: nothing was written to the gripper, and nothing but questions to the arm"
        )
        return 0

    def _connect(self, report: Report) -> Devices:
        return connect(self.arguments, self.recipe, self.drivers, self.stack, report)

    def _monitor(self) -> Monitor:
        recipe = self.recipe
        return Monitor(recipe.console, recipe.loaded, recipe.path, views(self.arguments))

    def _begin(
        self, journal: Journal, begun: Replay | None, monitor: Monitor, recipes: Sequence[Recipe]
    ) -> None:
        """Records in the journal that a run begins, or that a run which broke off continues.

        From then on a stop request raises only in `stoppable` code, so that the run always gets its last
        record.

        Args:
            journal: the journal.
            begun: the run to continue; None: a new run begins.
            monitor: notifies the service manager that the run begins.
            recipes: the tables of the run.
        """
        self.stack.enter_context(interrupts.whole())
        monitor.ready()
        for recipe in recipes:
            log.note(journal, recipe.loaded.data, recipe.software)
        data, policy = self.recipe.loaded.data, self.arguments.after_crash
        crash.begin(journal, begun, data, self.recipe.header, policy)

    def _look_back(self, clock: SystemClock) -> tuple[Journal | None, Replay | None]:
        """Opens the journal if it exists, and looks whether its last run broke off.

        Returns:
            The journal, None if there is none yet; and the run to continue, None if there is none.

        Raises:
            JournalError: the journal cannot be opened, or does not verify.
            BrokenRunError: the last run broke off, and may not be continued. With --put-down this is only a
                note on the console.
        """
        arguments = self.arguments
        if not files.exists(arguments.journal):
            return None, None
        journal = self._journal(clock)
        header = {**self.recipe.header, "table_sha256": self.recipe.loaded.digest}
        console, policy = self.recipe.console, arguments.after_crash
        try:
            broken = crash.look(journal, header, policy, console, arguments.resume_within)
        except BrokenRunError as error:
            if not arguments.put_down:
                raise
            console.note(str(error))
            broken = None
        return journal, broken

    def _journal(self, clock: SystemClock) -> Journal:
        return self.stack.enter_context(Journal(self.arguments.journal, clock.stamp, clock.uptime))

    def _holds(self, devices: Devices, journal: Journal | None) -> held.Held | None:
        """Looks whether the fingers may hold something before a run; checks that the gripper can move.

        Returns:
            What the fingers may hold; None if they hold nothing.

        Raises:
            GripperStateError: the fingers may hold something, and neither --put-down nor --jaws-empty is
                given; or the gripper is not ready to move, and this run will not activate it.
        """
        arguments, options = self.arguments, self.recipe.options
        state = devices.gripper.state()
        holds = held.look(state, options.handling.widths(self.recipe.loaded.table))
        if arguments.put_down and holds is None:
            return None
        if not (options.activate and needs_activation(state)) or arguments.put_down:
            ready_gripper(devices.gripper)
        if holds is not None and not (arguments.put_down or arguments.jaws_empty):
            raise holds.refusal(devices.arm.pose()[2], journal)
        return holds

    def _auditor(self, devices: Devices) -> AuditProcess | None:
        """Starts the program of `--audit`, and checks that it can judge parts; None without this option."""
        if self.arguments.audit is None:
            return None
        command = self.arguments.audit.replace(SIMULATED_CAMERA, devices.camera)
        process = AuditProcess(command, table_sha256=self.recipe.loaded.digest)
        auditor = self.stack.enter_context(process)
        auditor.check()
        return auditor

    def _is_low(self, arm_mm: float) -> bool:
        """Whether an arm at this height is below the height at which it travels."""
        return arm_mm < self.recipe.loaded.table.limits.retreat_height_um / 1000 - LEVEL_MM

    def _say_put_down(self, record: Mapping[str, object] | None, stands: str = "") -> int:
        if self.arguments.json:
            say(json.dumps({"put_down": record}))
        elif record is None:
            self.recipe.console.note(f"the fingers hold nothing; nothing was moved{stands}")
        else:
            self.recipe.console.note(
                f"put down at ({record['x_mm']:.2f}, {record['y_mm']:.2f}) mm, {record['width_mm']:.2f} mm "
                "between the fingers; the run ends here: look where it lies, then start again"
            )
        return 0


def _believed(table: Table) -> str:
    """States in a sentence which values of a table were compared with its job, and which were not."""
    figures = "whether its figures are right only an evaluation tells: plan-evaluate"
    if table.job is None:
        compared = "its heights, limits and poses were compared with nothing"
        return f"the table carries no job: {compared}; {figures}"
    return f"heights, limits, squeezes and poses agree with the job in the table; {figures}"
