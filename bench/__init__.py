"""Everything that can be true: the arm as it really is, and what measures it.

The functions of this file are what a notebook needs of it; the modules behind them are
imported when they are used first, and MuJoCo with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bench.shared import lazy_names

if TYPE_CHECKING:
    from bench import effects
    from bench.effects.effect import Effect
    from bench.instruments import Instruments
    from bench.patch import Patch
    from bench.proof.proof import Proof
    from bench.rig import Rig
    from bench.shared.format.folder import write
    from bench.shared.models import RobotModel
    from bench.shared.plan import LoadStep, Plan
    from bench.shared.recording import Recording

__all__ = [
    "Instruments",
    "Patch",
    "Recording",
    "Rig",
    "RobotModel",
    "effects",
    "load_model",
    "plan",
    "prove",
    "read",
    "simulate",
    "write",
]

__getattr__ = lazy_names(
    __name__,
    {
        "Effect": "bench.effects.effect",
        "Instruments": "bench.instruments",
        "LoadStep": "bench.shared.plan",
        "Patch": "bench.patch",
        "Plan": "bench.shared.plan",
        "Proof": "bench.proof.proof",
        "Recording": "bench.shared.recording",
        "Rig": "bench.rig",
        "RobotModel": "bench.shared.models",
        "effects": "bench.effects",
        "write": "bench.shared.format.folder",
    },
)


def __dir__() -> list[str]:
    return __all__


def load_model(file: Path | str) -> RobotModel:
    """Read a robot's model.

    Args:
        file: MJCF or URDF, with masses if the arm's own weight matters.

    Raises:
        BenchError: Where there is no such file.
        Unusable: Where it is no model that can be compiled, with all reasons.
    """
    from bench.model_file import facts_of, load, plain_mjcf
    from bench.shared.models import RobotModel

    model = load(file)
    return RobotModel(Path(file), plain_mjcf(model), facts_of(model))


def read(folder: Path | str, model: RobotModel | Path | str | None = None) -> Recording:
    """Read a recording; what it holds that was not used stands in its `notes`.

    Args:
        folder: Of the recording.
        model: The robot or its file, whose names and limits it is checked against;
            None: neither.

    Raises:
        Unusable: With every fault, each with file, row and column.
    """
    from dataclasses import replace

    from bench.shared.format import folder as files

    if isinstance(model, Path | str):
        model = load_model(model)
    recording, notes = files.read(folder, None if model is None else model.facts)
    return replace(recording, notes=notes)


def plan(
    model: RobotModel | None = None,
    poses: int = 151,
    path: Sequence[LoadStep] | None = None,
    seed: int = 0,
) -> Plan:
    """Return postures and loads that show all axes of an arm at work.

    Args:
        model: The robot; None: a KR10 R1100-2, whose postures are those of Table 1 of
            Wu et al. 2024.
        poses: How many postures; that table has 151.
        path: What hangs on the hook in each; None: the usual loads, less where the arm
            carries less.
        seed: Of the postures, where they are spread over joint limits.

    Raises:
        Unusable: Where the arm has not that many postures, with what is in their way.
    """
    from bench import standard_plans
    from bench.payload import payload_of, usual_path
    from bench.rig import Rig
    from bench.shared.plan import DEFAULT_PATH

    if model is None:
        steps = DEFAULT_PATH if path is None else tuple(path)
        return standard_plans.table_one_plan(poses, steps)
    rig = Rig(model.file)
    steps = usual_path(payload_of(rig)) if path is None else tuple(path)
    return standard_plans.tour(rig, poses, steps, seed=seed)


def simulate(
    model: RobotModel,
    plan: Plan,
    effects: Sequence[Effect] = (),
    instruments: Instruments | None = None,
    seed: int = 0,
) -> Recording:
    """Carry out a plan on a robot with hidden effects; return what instruments read.

    Args:
        model: The robot.
        plan: Postures and loads.
        effects: All that is true of it beyond its model; see `bench.effects`.
        instruments: What watches; None: a tracker and a force sensor as their makers
            state them.
        seed: Of all random draws; the same seed gives the same numbers.

    Raises:
        BenchError: Where no equilibrium is found.
        Unusable: Where an effect cannot be built into this robot.
    """
    from bench.effects.places import misplaced
    from bench.experiment import record
    from bench.rig import Rig
    from bench.shared.errors import refuse

    rig = Rig(model.file, tuple(effects))
    refuse("Effects", [f for e in effects for f in misplaced(e, rig.anatomy)])
    return record(rig, plan, instruments, seed)


def prove(
    patch: Patch,
    recording: Recording,
    model: RobotModel,
    held_out: Sequence[int],
    thorough: bool = True,
) -> Proof:
    """Prove a patch in the simulator, on poses that nothing is fitted to.

    Args:
        patch: Effects, springs and laws that the model leaves out.
        recording: What was done and seen.
        model: The nominal robot.
        held_out: Ids of the poses that judge; the others refine the patch.
        thorough: Whether placebos, and poses and loads left out, are tried too.

    Returns:
        Errors before and after with the interval of the gain, the share that is
        explained, and the patch as it was refined.

    Raises:
        BenchError: Where the patch cannot be built or finds no rest.
    """
    from bench.proof.proof import prove as run

    return run(recording, model.file, patch, held_out, thorough)
