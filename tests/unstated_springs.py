"""Model files of an arm that state nothing of its joints' stiffness."""

from pathlib import Path

from scenarios.studies.arm_trials import given


def as_mjcf(arm_file: Path, folder: Path) -> Path:
    """Write an arm as plain MJCF without joint stiffness."""
    return given(arm_file, "none", folder)


def as_urdf(arm_file: Path, folder: Path) -> Path:
    """Write a chain of hinges as URDF, which knows no stiffness; axes start at 0."""
    return given(arm_file, "urdf", folder)
