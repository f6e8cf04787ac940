"""Why a simulated cell cannot start; `exit_code` is what grasp-cell returns."""


class SimulationError(Exception):
    """The simulated cell cannot start."""

    exit_code = 31


class SimulationFileError(SimulationError):
    """An input file is missing or unreadable."""

    exit_code = 3
