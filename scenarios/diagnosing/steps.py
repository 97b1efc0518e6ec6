"""First the engine is asked, then the simulator; neither may break on odd numbers."""

from dataclasses import replace
from pathlib import Path

from bench.errors import BenchError
from bench.proof import Proof, prove
from bench.recording import Recording
from scenarios.diagnosing.patching import patch_of
from stiffness.arm import Arm
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.diagnosis import Diagnosis, Warned
from stiffness.diagnosis.set_up import mistakes_of_set_up

ODD_NUMBERS = (ArithmeticError, AssertionError, LookupError, TypeError, ValueError)
"""What arithmetic raises on numbers that no sensor gives; LinAlgError is among them."""


def asked(recording: Recording, arm: Arm) -> Diagnosis:
    """Ask the engine.

    Raises:
        BenchError: Where the recording has nothing to compare, or its numbers break the
            engine's arithmetic.
    """
    try:
        return diagnose(recording, arm)
    except ODD_NUMBERS as error:
        raise _odd(recording, error) from error


def slips(recording: Recording, arm: Arm) -> tuple[Warned, ...]:
    """Ask for the mistakes of the set-up alone.

    Raises:
        BenchError: Where the recording's numbers break the engine's arithmetic.
    """
    try:
        return mistakes_of_set_up(recording, arm)
    except ODD_NUMBERS as error:
        raise _odd(recording, error) from error


def proved(
    found: Diagnosis, recording: Recording, arm: Arm, robot: Path
) -> tuple[Proof | None, str]:
    """Put what was named into the simulator.

    Returns:
        The simulated arms, nominal and patched; and why nothing was proved, empty where
        something was.
    """
    if found.nominal is None:
        return None, "a mistake of the set-up has to be mended first."
    patch = patch_of(found, recording, arm)
    why = ""
    if not (patch.effects or patch.laws):
        why = "nothing was named." if not found.named else (
            "the simulator has no mechanism for what was named."
        )  # fmt: skip
    elif not found.held_out:
        why = "too few poses to keep any back."
    try:
        return prove(recording, robot, patch, found.held_out), why
    except (BenchError, *ODD_NUMBERS) as error:
        why = why or f"the simulator cannot do it ({error})."
    try:  # pictures need the nominal arm alone
        bare = replace(patch, effects=(), laws=())
        return prove(recording, robot, bare, found.held_out), why
    except (BenchError, *ODD_NUMBERS):
        return None, why


def _odd(recording: Recording, error: Exception) -> BenchError:
    return BenchError(
        f"Recording {recording.name!r} cannot be diagnosed: its numbers lead to "
        f"{type(error).__name__} ({error}). Look for values that no sensor gives."
    )
