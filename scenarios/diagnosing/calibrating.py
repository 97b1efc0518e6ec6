"""Without a load, what is wrong is mostly many small errors of geometry.

The diagnosis names a few effects; an arm that nobody calibrated has dozens. Where
it finds a difference and cannot explain it, calibration is asked.
"""

from pathlib import Path

from rich.console import Console

from bench.errors import BenchError
from bench.recording import Recording
from scenarios.calibrating.carried_out import Outcome, carried_out
from scenarios.diagnosing.steps import ODD_NUMBERS
from stiffness.arm import Arm
from stiffness.diagnosis.diagnosis import Diagnosis


def is_called_for(recording: Recording, found: Diagnosis) -> bool:
    """Return whether positions without a load differ and a few names do not do."""
    return (
        recording.wrench is None
        and recording.displacement == "absolute"
        and recording.rows == "plateaus"
        and found.nominal is not None
        and found.verdict in ("unexplained", "partly_explained")
    )


def tried(
    recording: Recording, arm: Arm, robot: Path, console: Console, rejected: float
) -> Outcome | None:
    """Calibrate, or say why that cannot be and return None.

    Args:
        recording: Absolute positions without a load.
        arm: The nominal arm, with the recording's names.
        robot: Its model's file.
        console: Where it is told.
        rejected: p-value of the nominal arm in the test that found the difference.
    """
    console.print("No few effects explain it: calibrating on positions.")
    try:
        return carried_out(recording, arm, robot, rejected=rejected)
    except (BenchError, *ODD_NUMBERS) as error:
        console.print(f"It cannot be calibrated on: {error}", markup=False)
        return None
