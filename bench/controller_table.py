"""Corrected numbers for a robot's controller: geometry, zeros, springs and masses.

A chain of axes at the angles q, in the base's frame, with z the axis that turns:

    base_from_flange = B A(1) A(2) ... A(n-1) Rz(q_n) F
    A(k) = Rz(theta_k + q_k) Tz(d_k) Tx(a_k) Rx(alpha_k) Ry(beta_k)

B (row `base`) stands on the first axis, F (row `flange`) is what follows the last;
their rotations are rotation vectors. Where an axis slides, q_k adds to d_k. Denavit and
Hartenberg 1955 leave beta zero. Where an axis is nearly parallel to the next, their
common normal is wherever the least error puts it; there d is zero instead (Hayati and
Mirmirani 1985).

The offset of an encoder, `mastering_offset`, is what q exceeds the reported angle by.
A controller whose q is counted the other way wants it with the other sign.

Of several arms each chain has such steps. Those of axes that chains share stand once;
where an axis carries several others, the step to each is a row of its own, `a2:a10`.
"""

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.effects.joint_compliance import JointCompliance
from bench.kinematic_chain import Anatomy
from bench.model_file import LEAST_KG, RIGID
from bench.rig import Rig
from bench.shared.recording import transform_of

FILE = "controller.csv"
PARALLEL = np.sin(np.radians(5.0))
"""Sine of the angle below which two axes count as parallel; chosen."""
LEAST_LENGTH = 1e-9
"""Length in m below which a direction is not taken from it."""


@dataclass(frozen=True)
class Step:
    """From one axis to the next.

    Attributes:
        theta: Angle about the axis at q = 0, in rad.
        d: Distance along the axis, in m; zero where the next one is parallel.
        a: Distance across it, in m.
        alpha: Angle about x, in rad.
        beta: Angle about y, in rad; zero where the next one is not parallel.
    """

    theta: float
    d: float
    a: float
    alpha: float
    beta: float

    def frame(self, q: float = 0.0, slides: bool = False) -> Float[np.ndarray, "4 4"]:
        """Return A(k) at an angle (a stroke) of its axis."""
        turn, stroke = (0.0, q) if slides else (q, 0.0)
        about = Rotation.from_rotvec([0, 0, self.theta + turn])
        askew = about * Rotation.from_euler("XY", [self.alpha, self.beta])
        place = about.apply([self.a, 0.0, self.d + stroke])
        return transform_of(askew.as_matrix(), place)


@dataclass(frozen=True)
class Geometry:
    """A chain's B, A(k) and F.

    Attributes:
        base: B.
        flange: F.
    """

    base: Float[np.ndarray, "4 4"]
    steps: tuple[Step, ...]
    flange: Float[np.ndarray, "4 4"]
    slides: tuple[bool, ...]

    def base_from_flange(self, q: Float[np.ndarray, " axes"]) -> np.ndarray:
        """Return where the flange stands at the true angles q, in rad (m)."""
        whole = self.base
        for step, angle, slide in zip(self.steps, q, self.slides, strict=False):
            whole = whole @ step.frame(angle, slide)
        last = Step(0.0, 0.0, 0.0, 0.0, 0.0).frame(q[-1], self.slides[-1])
        return whole @ last @ self.flange


def geometry(
    model: mujoco.MjModel,
    arm: Anatomy,
    like: mujoco.MjModel | None = None,
    mount: int | None = None,
) -> Geometry:
    """Read a chain's geometry.

    Another arm may say which axes count as parallel and which way x points; the mount
    is the axis that carries the hand, by default the flange's.
    """
    mount = arm.mount if mount is None else mount
    lines, flange = _lines(model, arm, mount)
    drawn, _ = _lines(like or model, arm, mount)
    here, there = _on_first(lines[0], drawn[0]), _on_first(drawn[0], drawn[0])
    base, steps = here, []
    for line, as_drawn in zip(lines[1:], drawn[1:], strict=True):
        seen = _seen(there, as_drawn)
        step = _step(_seen(here, line), seen)
        here, there = here @ step.frame(), there @ _step(seen, seen).frame()
        steps.append(step)
    slides = tuple(arm.slides[k] for k in arm.carriers(mount))
    return Geometry(base, tuple(steps), np.linalg.inv(here) @ flange, slides)


@dataclass(frozen=True)
class _Line:
    """An axis: a point of it, in m, and its direction."""

    point: Float[np.ndarray, "3"]
    along: Float[np.ndarray, "3"]


def _lines(
    model: mujoco.MjModel, arm: Anatomy, mount: int
) -> tuple[list[_Line], np.ndarray]:
    """Return a hand's axes and the hand in the base's frame, all joints at zero."""
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    base, flange = data.body(arm.base), data.body(arm.hands[mount])
    stand = transform_of(base.xmat.reshape(3, 3), base.xpos)
    joints = [data.joint(arm.axes[k]) for k in arm.carriers(mount)]
    lines = [_seen(stand, _Line(joint.xanchor, joint.xaxis)) for joint in joints]
    hand = transform_of(flange.xmat.reshape(3, 3), flange.xpos)
    return lines, np.linalg.inv(stand) @ hand


def _seen(frame: Float[np.ndarray, "4 4"], line: _Line) -> _Line:
    """Return a line in a frame's own coordinates."""
    turn = frame[:3, :3].T
    return _Line(turn @ (line.point - frame[:3, 3]), turn @ line.along)


def _on_first(line: _Line, drawn: _Line) -> Float[np.ndarray, "4 4"]:
    """Return a frame on the first axis, x along the base's x, else along its y."""
    x = np.eye(3)[0 if abs(drawn.along[0]) < np.sqrt(0.5) else 1]
    x = x - (x @ line.along) * line.along
    x /= np.linalg.norm(x)
    turn = np.column_stack([x, np.cross(line.along, x), line.along])
    return transform_of(turn, line.point)


def _step(line: _Line, drawn: _Line) -> Step:
    """Return the step from z to a line, in the form that suits it as it was drawn."""
    place, along = line.point, line.along
    if np.hypot(*drawn.along[:2]) <= PARALLEL:
        at = place - place[2] / along[2] * along
        a = float(np.hypot(at[0], at[1]))
        theta = float(np.arctan2(at[1], at[0])) if a > LEAST_LENGTH else 0.0
        x, y, z = Rotation.from_rotvec([0, 0, -theta]).apply(along)
        beta = float(np.arcsin(np.clip(x, -1.0, 1.0)))
        return Step(theta, 0.0, a, float(np.arctan2(-y, z)), beta)
    across = np.cross(np.eye(3)[2], along)
    normal = across / np.linalg.norm(across)
    if drawn.point @ np.cross(np.eye(3)[2], drawn.along) < -LEAST_LENGTH:
        normal = -normal
    a = float(place @ normal)
    rest = place - a * normal  # goes on along the line to the foot on z
    foot = rest - (rest[:2] @ along[:2]) / (along[:2] @ along[:2]) * along
    theta = float(np.arctan2(normal[1], normal[0]))
    return Step(
        theta, float(foot[2]), a, float(np.arctan2(across @ normal, along[2])), 0.0
    )


# --- The table ------------------------------------------------------------------------

HEADER = ("part", "quantity", "unit", "nominal", "corrected", "change")
Row = tuple[str, str, str, float, float]
"""Part, quantity, unit, nominal, corrected."""


def controller_table(rig: Rig, offset: Float[np.ndarray, " axes"]) -> str:
    """Return controller.csv: what a robot's controller may be told.

    The offset is that of each axis' encoder, true less reported angle, in rad (m).
    """
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(HEADER)
    for part, quantity, unit, nominal, corrected in _rows(rig, offset):
        numbers = (nominal, corrected, corrected - nominal)
        shown = ("" if np.isnan(x) else f"{round(x, 9) + 0.0:.9g}" for x in numbers)
        lines.writerow((part, quantity, unit, *shown))
    return text.getvalue()


def _rows(rig: Rig, offset: np.ndarray) -> Iterator[Row]:
    arm = rig.anatomy
    names = [f"a{k}" for k in range(1, len(arm.axes) + 1)]
    for name, slides, value in zip(names, arm.slides, offset, strict=True):
        size, unit = (1e3, "mm") if slides else (180 / np.pi, "deg")
        yield name, "mastering_offset", unit, 0.0, size * value
    seen: set[str] = set()
    for mount, hand in arm.hands.items():
        drawn = geometry(rig.nominal, arm, mount=mount)
        true = geometry(rig.model, arm, rig.nominal, mount)
        if not seen:
            yield from _pose_rows("base", drawn.base, true.base)
        chain = arm.carriers(mount)
        for k, after, old, new in zip(
            chain, chain[1:], drawn.steps, true.steps, strict=False
        ):
            forks = len(arm.carried(k)) > 1
            name = f"{names[k]}:{names[after]}" if forks else names[k]
            yield from () if name in seen else _step_rows(name, old, new)
            seen.add(name)
        part = "flange" if mount == arm.mount else hand
        yield from _pose_rows(part, drawn.flange, true.flange)
    own = np.where(rig.nominal.jnt_stiffness > 0, rig.nominal.jnt_stiffness, RIGID)
    named = {
        e.where: e.compliance_rad_per_nm
        for e in rig.effects
        if isinstance(e, JointCompliance)
    }
    for k, name in enumerate(names):
        unit = "N/m" if arm.slides[k] else "N m/rad"
        found = rig.springs[k]
        if name in named:
            found = 1.0 / (1.0 / found + named[name])
        old, new = (float(x) if x < RIGID else np.nan for x in (own[k], found))
        yield name, "stiffness", unit, old, new
    for b in range(1, rig.nominal.nbody):
        name = rig.nominal.body(b).name
        nominal, corrected = rig.nominal.body_mass[b], rig.model.body(name).mass[0]
        moments = [
            m.body(name).ipos * m.body(name).mass for m in (rig.nominal, rig.model)
        ]
        if name == arm.flange:  # what is mounted is no correction
            corrected -= rig.mounted.payload.mass
            moments[1] = moments[1] - rig.mounted.payload.mass * rig.mounted.payload.com
        if abs(corrected - nominal) > LEAST_KG:
            yield name, "mass", "kg", float(nominal), float(corrected)
            for i, axis in enumerate("xyz"):
                old, new = (
                    1e3 * float(moment[i] / mass) if mass > LEAST_KG else np.nan
                    for moment, mass in zip(moments, (nominal, corrected), strict=True)
                )
                yield name, f"centre_{axis}", "mm", old, new


def _step_rows(part: str, old: Step, new: Step) -> Iterator[Row]:
    for key in ("theta", "d", "a", "alpha", "beta"):
        size, unit = (1e3, "mm") if key in "da" else (180 / np.pi, "deg")
        before, after = size * getattr(old, key), size * getattr(new, key)
        if unit == "deg":  # the same angle, as near as it can be written
            after -= 360.0 * round((after - before) / 360.0)
        yield part, key, unit, before, after


def _pose_rows(part: str, old: np.ndarray, new: np.ndarray) -> Iterator[Row]:
    turns = [
        Rotation.from_matrix(f[:3, :3]).as_rotvec(degrees=True) for f in (old, new)
    ]
    size = np.linalg.norm(turns[1])
    if size > 0.0:  # the same rotation the other way round, where that is nearer
        other = turns[1] * (1.0 - 360.0 / size)
        turns[1] = min(turns[1], other, key=lambda x: np.linalg.norm(x - turns[0]))
    for i, axis in enumerate("xyz"):
        yield part, axis, "mm", 1e3 * old[i, 3], 1e3 * new[i, 3]
    for i, axis in enumerate("xyz"):
        yield part, f"rotation_vector_{axis}", "deg", turns[0][i], turns[1][i]
