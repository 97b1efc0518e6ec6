"""Benchmark tasks: experiment, recordings, source domain, springs, diagnosis.

An experiment of static states can be solved for each equilibrium, or stepped through as
time passes. The other way does what a user of MuJoCo does: the same model with damping,
the implicit integrator, loads applied gradually, and every load held for as long as the
plan says, since creep depends on time. It uses as many threads as ours, and is run for
two readings of a few visits and scaled to all the seconds of the plan.

A recording that is checked cell by cell costs more to read than a plain table. The
other ways only turn the samples into an array, or back, without units, manifest or
checks: their difference from ours is the cost of the checks.

Deflections of the source domain are one product of arrays, or a loop over postures.

Six springs are fitted by linear least squares, or by a general optimiser on MuJoCo. The
other ways have MuJoCo find the equilibrium of all cases at once, and differ in their
optimiser. They are given the deflections and start within a factor of two; ours starts
from the recording, and from a rigid arm.

The diagnosis ranks causes in columns. One other way simulates the mechanism of each
hypothesis once, at one site and with one size, and compares nothing: a lower bound on
any search by simulation. One simulation is run and its time multiplied. The other is
this diagnosis on a longer recording, its time divided by how much longer it is.
"""

import copy
import csv
import io
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pyarrow.csv
from jaxtyping import Float
from mujoco import batch, minimize, sysid
from scipy.optimize import least_squares

from bench.cell import GRAVITY
from bench.effects.hysteresis import Hysteresis
from bench.experiment import record
from bench.instruments import Instruments
from bench.rig import Rig
from bench.shared.format import folder as files
from bench.shared.format.table import CSV_FILE
from bench.shared.plan import LoadStep, Plan
from bench.standard_plans import spread_plan
from bench.standard_plans import table_one_plan as table_one
from bench.study_arm import default_truth
from scenarios.pipelines.synthetic_recording import KR10
from scenarios.studies.benchmarks.race import Race, Way
from scenarios.studies.paper import TABLE_03_NM_PER_RAD
from stiffness.diagnosis.diagnose import diagnose
from stiffness.effects import HYPOTHESES
from stiffness.experiment.deflections import Deflections, one_per_pose
from stiffness.methods.vjm import Vjm, VjmFit
from stiffness.networks.source_domain import (
    SourcePlan,
    source_domain,
    spanning_plan,
    table_4_postures,
)
from stiffness.robot.arm import Arm

# --- Simulating an experiment ---------------------------------------------------------

PAPERS = 151
"""Number of postures of the paper's experiment, to which bars apply."""
TWO_READINGS = (LoadStep(0.0), LoadStep(10.0))
DAMPING_TIME = 0.03
"""Damping over stiffness, in s; chosen: slower than the arm's swing of 10 to 13 Hz."""
RAMP = 0.5
"""Time in which a load is applied, in s; chosen: several periods of that swing."""
TIME_STEPS = (2e-3, 5e-3)
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
                for step in TIME_STEPS
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

    Effects of ropes and commands are not stepped; the time step is in s.
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

    Each has nine rows of 28 markers a posture; the caller removes the files.
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


# --- Rows of the source domain --------------------------------------------------------

POINT, ORIGIN = np.array([0.01, 0.0, 0.06]), np.array([0.0, 0.0, 0.0254])
"""Points in the flange's frame, in m; chosen: a tool's tip and a sensor's face."""


def source_race(postures: int | None = None) -> Race:
    """Return the race over the source domain.

    It asks the first so many of Table 4's 21,280 postures, or all.
    """
    plan = spanning_plan(table_4_postures()[:postures])
    arm, compliance = Arm.from_mjcf(KR10), 1.0 / np.array(TABLE_03_NM_PER_RAD)
    model = pin.buildModelFromMJCF(str(KR10))
    return Race(
        task=f"source domain: {plan.rows:,} rows by fitted springs",
        ways=(
            Way(
                "stiffness.networks.source_domain",
                lambda: source_domain(arm, compliance, plan, POINT, ORIGIN).deflection,
            ),
            Way("Pinocchio loop", lambda: pinocchio_loop(model, compliance, plan)),
        ),
        difference=lambda ours, other: f"{1e3 * np.abs(ours - other).max():.1g} mm",
        bar=0.5 if postures is None else None,
        rounds=2,
    )


def pinocchio_loop(
    model: pin.Model, compliance: Float[np.ndarray, " axes"], plan: SourcePlan
) -> Float[np.ndarray, "rows 3"]:
    """Return displacements in m by a loop over postures, with two Jacobians each."""
    model = pin.Model(model)
    flange = model.frames[model.getFrameId("flange")]
    ids = []
    for name, place in (("point", POINT), ("origin", ORIGIN)):
        placement = flange.placement * pin.SE3(np.eye(3), place)
        kind = pin.FrameType.OP_FRAME
        ids.append(model.addFrame(pin.Frame(name, flange.parentJoint, placement, kind)))
    data, along_base = model.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    moved = []
    for posture, wrench in zip(plan.posture, plan.wrench_in_base, strict=True):
        pin.computeJointJacobians(model, data, posture)
        pin.updateFramePlacements(model, data)
        point, origin = (pin.getFrameJacobian(model, data, i, along_base) for i in ids)
        moved.append((wrench @ origin * compliance) @ point[:3].T)
    return np.concatenate(moved)


# --- The fit of six springs -----------------------------------------------------------

START = np.log(np.array([35e3, 90e3, 35e3, 3.5e3, 6e3, 2e3]))
"""Initial log stiffness, of N m/rad; chosen: within a factor of two of Table 3."""
LARGE, STEPS = 100.0, 6
"""Time step of the `discrete` integrator in s, and steps: each is one of Newton's, and
after five nothing changes."""

Residual = Callable[[Float[np.ndarray, " axes"]], Float[np.ndarray, " coordinates"]]


def springs_race(poses: int) -> Race:
    """Return the race over a recording of linear springs, one loaded row a pose."""
    rig, path = Rig(KR10), (LoadStep(0.0), LoadStep(10.0))
    recording = record(rig, table_one(poses, path), Instruments(), seed=0)
    arm = Arm.from_mjcf(KR10).for_recording(recording)
    vjm = Vjm(arm, select=one_per_pose)
    residual = _residual(one_per_pose(arm, recording))
    ways = [
        Way("stiffness.methods.vjm", lambda: vjm.fit(recording)),
        Way(
            "scipy.least_squares, MuJoCo Batch",
            lambda: np.exp(least_squares(residual, START).x),
        ),
        Way("mujoco.minimize, MuJoCo Batch", lambda: _minimised(residual)),
    ]
    skipped = ()
    if hasattr(sysid, "optimize"):
        ways.append(Way("mujoco.sysid, MuJoCo Batch", lambda: _identified(residual)))
    else:
        skipped = (
            "mujoco.sysid: its extra packages are not installed "
            "(pip install 'mujoco[sysid]'); its optimiser is mujoco.minimize.",
        )
    return Race(
        task=f"fit: six springs to {poses} rows",
        ways=tuple(ways),
        difference=_difference,
        bar=0.020 if poses == PAPERS else None,
        rounds=3,
        skipped=skipped,
    )


def _difference(ours: VjmFit, other: np.ndarray) -> str:
    apart = [
        abs(p.value - k) / p.sigma for p, k in zip(ours.stiffness, other, strict=True)
    ]
    return f"{max(apart):.1g} sigma of a spring"


def _residual(data: Deflections) -> Residual:
    """Return the residual as a function of log stiffness, in sigmas of the tracker."""
    cases, model = data.cases, _model(data)
    count = len(cases)
    runs = batch.Batch(model, nsim=2 * count, nthread=os.cpu_count() or 1)
    posture = np.concatenate([cases.posture, cases.posture])
    slack, stiffness = runs.expand("qpos_spring"), runs.expand("jnt_stiffness")
    slack[:] = posture
    load, qpos, qvel = (runs.bind(n) for n in ("ctrl", "qpos", "qvel"))
    load[:count] = data.wrench_in_flange
    place, turn = runs.bind("xpos"), runs.bind("xmat")
    flange, sigma = model.body("flange").id, data.sigma

    def residual(log_stiffness: np.ndarray) -> np.ndarray:
        stiffness[:] = np.exp(log_stiffness)
        qpos[:] = posture
        qvel[:] = 0.0
        runs.step(nstep=STEPS)
        runs.forward()
        turned = turn[:, flange].reshape(2, count, 3, 3)
        ends = place[:, flange].reshape(2, count, 3)
        ends = ends + np.einsum("encd,nd->enc", turned, cases.point_in_flange)
        return ((ends[0] - ends[1] - data.deflection) / sigma).ravel()

    return residual


def _model(data: Deflections) -> mujoco.MjModel:
    """Return the arm with its payload, without ropes, which halves a step's cost."""
    spec, tool = mujoco.MjSpec.from_file(str(KR10)), data.cases.payload
    flange = spec.body("flange")
    flange.add_site(name="face", pos=data.cases.origin_in_flange)
    for along in np.eye(6):  # a load that turns with the sensor that measured it
        site = mujoco.mjtTrn.mjTRN_SITE
        spec.add_actuator(target="face", trntype=site).gear = along
    if tool is not None:
        held = flange.add_body(name="held", pos=tool.com)
        held.mass, held.inertia = tool.mass, np.full(3, 1e-4 * tool.mass)
        held.explicitinertial = True
    off = mujoco.mjtDisableBit
    spec.option.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_LIMIT
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    spec.option.timestep = LARGE
    return spec.compile()


def _minimised(residual: Residual) -> Float[np.ndarray, " axes"]:
    """Fit by MuJoCo's Gauss-Newton, which evaluates many columns at once."""
    silent = minimize.Verbosity.SILENT
    found, _ = minimize.least_squares(START, _columns(residual), verbose=silent)
    return np.exp(found.ravel())


def _columns(residual: Residual) -> Residual:
    return lambda x: np.stack([residual(column) for column in np.atleast_2d(x.T)], 1)


def _identified(residual: Residual) -> Float[np.ndarray, " axes"]:
    """Fit by MuJoCo's toolbox for system identification, with its defaults."""
    wide = np.log(10.0)
    springs = sysid.Parameter("springs", START, START - wide, START + wide)
    every = _columns(residual)
    with redirect_stdout(io.StringIO()):
        found, _ = sysid.optimize(
            initial_params=sysid.ParameterDict({"springs": springs}),
            residual_fn=lambda x, _: ([every(x)], None, None),
            verbose=False,
        )
    return np.exp(found.as_vector())


# --- Diagnosis ------------------------------------------------------------------------

LONGER = 4
"""Factor on the poses of the longer recording; chosen for time."""


def diagnosis_race(poses: int) -> Race:
    """Return the race over the diagnosis of one hysteretic axis."""
    rig, plan = Rig(KR10, (Hysteresis("a2", width_rad=2.9e-4),)), table_one(poses)
    recording, arm = record(rig, plan), Arm.from_mjcf(KR10)
    many = LONGER * len(plan.posture)
    longer = record(rig, spread_plan(f"{many} postures", rig, many, plan.path))
    count = len(HYPOTHESES)
    return Race(
        task=f"diagnosis: {len(recording.time)} rows, {count} hypotheses",
        ways=(
            Way("stiffness.diagnosis", lambda: diagnose(recording, arm)),
            Way(
                f"one simulation for each of {count} hypotheses",
                lambda: rig.carry_out(plan),
                share=1 / count,
            ),
            Way(
                f"ours on {LONGER} times the poses, for each of them",
                lambda: diagnose(longer, arm),
                share=LONGER,
            ),
        ),
        bar=3.0 if poses == PAPERS else None,
    )
