"""Benchmark tasks that simulate an experiment, and that read and write recordings.

An experiment of static states can be solved for each equilibrium, or stepped through as
time passes. The other way does what a user of MuJoCo does: the same model with damping,
the implicit integrator, loads applied gradually, and every load held for as long as the
plan says, since creep depends on time. It uses as many threads as ours, and is run for
two readings of a few visits and scaled to all the seconds of the plan.

A recording that is checked cell by cell costs more to read than a plain table. The
other ways only turn the samples into an array, or back, without units, manifest or
checks: their difference from ours is the cost of the checks.
"""

import copy
import csv
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np
import pyarrow.csv
from jaxtyping import Float

from bench.cell import GRAVITY
from bench.experiment import record
from bench.rig import Rig
from bench.shared.format import folder as files
from bench.shared.format.table import CSV_FILE
from bench.shared.plan import LoadStep, Plan
from bench.standard_plans import table_one_plan as table_one
from bench.study_arm import default_truth
from scenarios.studies.benchmarks.race import Race, Way

# --- Simulating an experiment ---------------------------------------------------------

KR10 = Path(__file__).parents[3] / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml"
PAPERS = 151
"""Number of postures of the paper's experiment, to which bars apply."""
TWO_READINGS = (LoadStep(0.0), LoadStep(10.0))
DAMPING_TIME = 0.03
"""Damping over stiffness, in s; chosen: slower than the arm's swing of 10 to 13 Hz."""
RAMP = 0.5
"""Time in which a load is applied, in s; chosen: several periods of that swing."""
STEPS = (2e-3, 5e-3)
"""Time steps in s: MuJoCo's default, and a larger one at which bearings are stable."""


def experiment_race(poses: int) -> Race:
    """Return the race over the experiment of Table 1 on the default truth."""
    truth = default_truth()
    plan, cores = table_one(poses), os.cpu_count() or 1
    few = table_one(min(cores, poses), TWO_READINGS)

    def rig() -> Rig:
        return Rig(KR10, truth.effects, truth.stiffness)

    stepped = rig()
    jumped = flange(stepped, few)
    share = _seconds(few) / _seconds(plan)
    return Race(
        task=f"experiment: {plan.rows} readings of 28 markers, all effects",
        ways=(
            Way("bench.experiment.record", lambda: record(rig(), plan)),
            *(
                Way(
                    f"damped stepping, {1e3 * step:g} ms",
                    lambda step=step: damped_stepping(stepped, few, step),
                    share,
                )
                for step in STEPS
            ),
        ),
        difference=lambda _, other: f"{1e6 * np.abs(other - jumped).max():.2g} µm",
        bar=5.0 if poses == PAPERS else None,
    )


def flange(rig: Rig, plan: Plan) -> Float[np.ndarray, "visits readings 3"]:
    """Return the flange's positions at rest in m, by `bench.equilibrium`."""
    states = rig.carry_out(plan)
    place = states.position[:, states.bodies.index(rig.anatomy.flange)]
    return place.reshape(plan.visits, -1, 3)


def damped_stepping(
    rig: Rig, plan: Plan, time_step: float
) -> Float[np.ndarray, "visits readings 3"]:
    """Step through a plan in time, one thread a visit; return the flange, in m.

    Args:
        rig: The arm with its effects; those of ropes and commands are not stepped.
        plan: The experiment.
        time_step: Time step, in s.
    """
    rig.model  # noqa: B018  compiled before the threads share it
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        visits = range(plan.visits)
        places = threads.map(lambda v: _visit(rig, plan, v, time_step), visits)
        return np.array(list(places))


def _visit(
    rig: Rig, plan: Plan, visit: int, time_step: float
) -> Float[np.ndarray, "readings 3"]:
    model = copy.copy(rig.model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.timestep = time_step
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_LIMIT
    damping = DAMPING_TIME * model.jnt_stiffness
    for t in range(model.ntendon):
        first = model.tendon_adr[t]
        if model.wrap_type[first] == mujoco.mjtWrap.mjWRAP_JOINT:
            damping[model.wrap_objid[first]] += time_step * model.tendon_stiffness[t]
    own = model.dof_damping[model.jnt_dofadr]
    model.dof_damping[model.jnt_dofadr] = np.maximum(own, damping)  # creep has more
    command = rig.command(plan.posture[visit : visit + 1])
    axes = [model.joint(axis).id for axis in rig.anatomy.axes]
    address = model.jnt_qposadr[axes]
    model.jnt_stiffness[axes] = command.stiffness[0]
    # A joint's angle is qpos - qpos0: springs are slack at the motors' angles.
    model.qpos0[address] -= command.reference[0] - model.qpos_spring[address]
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos_spring
    gravity, mass, places = model.opt.gravity.copy(), 0.0, []
    rope = plan.pulley[visit] % model.nu
    for s, step in enumerate(plan.path):
        count = round(RAMP / time_step)
        for i in range(count):
            share = (1 - np.cos(np.pi * (i + 1) / count)) / 2
            data.ctrl[rope] = GRAVITY * (mass + share * (step.mass - mass))
            if s == 0:
                model.opt.gravity = share * gravity
            mujoco.mj_step(model, data)
        rest = round((step.hold - RAMP / 2) / time_step)
        mujoco.mj_step(model, data, rest)
        mass = step.mass
        places.append(data.body(rig.anatomy.flange).xpos.copy())
    return np.array(places)


def _seconds(plan: Plan) -> float:
    """Return how many seconds of the arm's time are stepped through."""
    return plan.visits * sum(step.hold + RAMP / 2 for step in plan.path)


# --- Reading and writing recordings ---------------------------------------------------


def reading_races(poses: int, folder: Path) -> tuple[Race, Race]:
    """Return the races over writing and reading one recording.

    Args:
        poses: Number of postures, nine rows of 28 markers each.
        folder: Empty folder for the files; removed by the caller.
    """
    recording = record(Rig(KR10), table_one(poses))
    files.write(folder / "ours", recording)
    table = folder / "ours" / CSV_FILE
    with table.open(newline="", encoding="utf-8") as source:
        names = next(csv.reader(source))
    numbers = _numbers(table)
    size = f"{len(recording.time)} rows, {len(names)} columns"
    writing = Race(
        task=f"write a recording: {size}",
        ways=(
            Way(
                "bench.shared.format.folder.write",
                lambda: files.write(folder / "new", recording),
            ),
            Way("csv module", lambda: _write(folder / "bare.csv", numbers)),
            Way(
                "numpy.savetxt",
                lambda: np.savetxt(folder / "np.csv", numbers, delimiter=","),
            ),
        ),
    )
    reading = Race(
        task=f"read a recording: {size}",
        ways=(
            Way(
                "bench.shared.format.folder.read",
                lambda: files.read(folder / "ours")[0],
            ),
            Way("csv module", lambda: _numbers(table)),
            Way("pyarrow.csv", lambda: pyarrow.csv.read_csv(table)),
        ),
    )
    return writing, reading


def _numbers(table: Path) -> np.ndarray:
    """Read a table of samples; cells that are not numbers become NaN."""
    with table.open(newline="", encoding="utf-8") as source:
        rows = list(csv.reader(source))[1:]
    return np.array([[_number(cell) for cell in row] for row in rows])


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _write(table: Path, numbers: np.ndarray) -> None:
    with table.open("w", newline="", encoding="utf-8") as out:
        csv.writer(out).writerows(numbers.tolist())
