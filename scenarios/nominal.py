"""One model file is the arm of a claim and the names that a recording must use."""

from dataclasses import replace
from pathlib import Path

from bench.files import read
from bench.format.faults import Place, visible
from bench.format.repeats import said_of_repeats
from bench.format.samples import CSV_FILE, PARQUET_FILE
from bench.model_facts import ModelFacts
from bench.model_file import load, plain_mjcf
from bench.recording import Recording
from scenarios.one_pose import said_of_one_pose
from stiffness.arm import Arm


def arm_of(path: Path) -> Arm:
    """Read the nominal arm from an MJCF or URDF file.

    Raises:
        BenchError: Where it cannot be read, saying why.
    """
    return Arm.from_mjcf_text(plain_mjcf(load(path)))


def facts_of(arm: Arm) -> ModelFacts:
    """Return the names and limits that a recording of this arm is checked against."""
    return ModelFacts(
        joints=arm.axes,
        slides=tuple(bool(slides) for slides in arm.slides),
        lower=arm.limits[:, 0],
        upper=arm.limits[:, 1],
        bodies=tuple(arm.chain.places),
    )


def read_for(folder: Path, arm: Arm) -> tuple[Recording, Arm, tuple[str, ...]]:
    """Read a recording of an arm.

    Returns:
        The recording, its names without what a terminal would obey; the arm with the
        recording's own names; and notes.

    Raises:
        Unusable: With every fault of the recording.
    """
    recording, notes = read(folder, facts_of(arm))
    shown = replace(
        recording,
        name=visible(recording.name),
        robot=visible(recording.robot),
        markers=tuple(replace(m, name=visible(m.name)) for m in recording.markers),
    )
    in_text = (folder / CSV_FILE).exists()
    place = Place(CSV_FILE if in_text else PARQUET_FILE, in_text)
    told = (*said_of_repeats(place, recording), *said_of_one_pose(recording))
    return shown, arm.for_recording(recording), (*notes, *told)
