"""Visibility: the size of an effect's signal that no nuisance parameter absorbs, as χ².

Nuisance parameters are the stiffness of springs that the model has, marker positions,
the tracker's frame where it is unknown, and per visit an error of the force of 0.3° and
0.5 %. Nothing here comes from the diagnosis.

Three sums: `within`, differences within visits, with a free rest position for every
visit and marker; `between`, means of visits; `whole`, both with one error of the force
for a visit, which is more than their sum. The size of an effect is the larger of the
first two, as load effects show in differences and geometry in means.

Visibility of an effect (`Scale`):

==========  ==========================================================================
Equation    χ² = min over β of |W (s - G β)|² + |β/prior|², s the noise-free
            displacement, G the nuisance columns, W'W = (S + U U')^-1 with S the
            tracker's noise and U the error of a visit's force; Woodbury per visit
Source      generalised least squares; first-order kinematics (Siciliano et al. 2009,
            section 3.1)
Valid       small displacements
Ignores     white noise of the force sensor, which moves a marker by less than 5 % of
            the tracker's; readings that are hidden
==========  ==========================================================================

Displacement of markers by the wind-up of an axis (`ReadingSensitivity`):

==========  ==========================================================================
Equation    dp = a_k × (p - o_k) θ_k for a marker beyond axis k, a_k θ_k where it
            slides; torque of a wrench at p_s: a_k · (T + (p_s - o_k) × F), or a_k · F
Source      first-order kinematics and virtual work: Siciliano et al. 2009, chapter 3
Valid       wind-ups of milliradians
Ignores     how a wind-up changes the lever arms of the load
==========  ==========================================================================

Residual after the nuisance columns, visit by visit (`Projection`):

==========  ==========================================================================
Equation    (1 + U U')^-1 = 1 - U (1 + U'U)^-1 U'; β = (G'AG + P)^-1 G'A s;
            χ² = (s - Gβ)' A (s - Gβ) + β'Pβ
Source      Sherman, Morrison and Woodbury 1950; ridge regression
Valid       signals and columns in sigmas
Ignores     nothing
==========  ==========================================================================
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import cho_factor, cho_solve

from bench.instruments.force_sensor import SIZE, TURN
from bench.kinematic_chain import carriers_of
from bench.rig import Rig
from bench.shared.recording import Recording

# --- Sensitivity of the readings ------------------------------------------------------


@dataclass(frozen=True)
class ReadingSensitivity:
    """Kinematics and loads of an arm at a plan's postures, along the base's axes.

    Attributes:
        point: Positions of the markers, in m.
        turn: base_from_body of each marker's body.
        origin: A point of each axis, in m.
        wind_up: Of each axis, in rad.
        beyond: Which markers each axis carries.
        stiffness: Of each axis' spring, in N m/rad.
        sensor: Position of the force sensor, in m.
        sensor_turn: base_from_sensor.
        felt: Its readings along the base's axes, in N and N m.
    """

    point: Float[np.ndarray, "visits rows markers 3"]
    turn: Float[np.ndarray, "visits markers 3 3"]
    axis: Float[np.ndarray, "visits axes 3"]
    origin: Float[np.ndarray, "visits axes 3"]
    wind_up: Float[np.ndarray, "visits rows axes"]
    beyond: Bool[np.ndarray, "axes markers"]
    slides: Bool[np.ndarray, " axes"]
    stiffness: Float[np.ndarray, " axes"]
    sensor: Float[np.ndarray, "visits 3"]
    sensor_turn: Float[np.ndarray, "visits 3 3"]
    felt: Float[np.ndarray, "visits rows 6"]

    def turned(
        self, k: int, angle: Float[np.ndarray, "visits rows"] | None = None
    ) -> Float[np.ndarray, "visits rows markers 3"]:
        """Return markers' displacements in m by an axis' angle, default its wind-up."""
        angle = self.wind_up[:, :, k] if angle is None else angle
        along = self.axis[:, None, None, k]
        lever = self.point - self.origin[:, None, None, k]
        moved = along + 0 * lever if self.slides[k] else np.cross(along, lever)
        return moved * angle[:, :, None, None] * self.beyond[k][:, None]

    def wrench(self, recording: Recording) -> Float[np.ndarray, "visits rows 6"]:
        """Return readings of the force sensor along the base's axes."""
        return along_base(recording, self.sensor_turn)

    def response(
        self, wrench: Float[np.ndarray, "visits rows 6"]
    ) -> Float[np.ndarray, "n markers 3"]:
        """Return the springs' deflection under a wrench at the sensor, by row, in m."""
        moved = np.zeros(self.point.shape)
        force, torque = wrench[..., :3], wrench[..., 3:]
        for k, stiffness in enumerate(self.stiffness):
            lever = self.sensor - self.origin[:, k]
            about = torque + np.cross(lever[:, None], force)
            about = force if self.slides[k] else about
            angle = np.einsum("vri,vi->vr", about, self.axis[:, k]) / stiffness
            moved += self.turned(k, angle)
        return moved.reshape(-1, *self.point.shape[2:])

    def force_errors(
        self, turn: float, size: float
    ) -> Float[np.ndarray, "visits rows markers 3 4"]:
        """Return displacements by errors of a visit's force: three turns and a scale.

        Their sigmas are in rad and relative.
        """
        parts = np.split(self.felt, 2, axis=-1)
        wrong = [
            turn * np.concatenate([np.cross(e, part) for part in parts], axis=-1)
            for e in np.eye(3)
        ]
        moved = [self.response(w) for w in (*wrong, size * self.felt)]
        return np.stack([m.reshape(self.point.shape) for m in moved], axis=-1)


def along_base(
    recording: Recording, sensor_turn: Float[np.ndarray, "visits 3 3"]
) -> Float[np.ndarray, "visits rows 6"]:
    """Return readings of the force sensor along the base's axes."""
    assert recording.wrench is not None
    split = recording.wrench.reshape(len(sensor_turn), -1, 2, 3)
    turned = np.einsum("vij,vrsj->vrsi", sensor_turn, split)
    return turned.reshape(*split.shape[:2], 6)


# --- Observed states ------------------------------------------------------------------


def reading_sensitivity_of(
    rig: Rig, seen: Recording, point: Float[np.ndarray, "rows markers 3"]
) -> ReadingSensitivity:
    """Return kinematics and loads of an arm at the postures its controller reports.

    It was seen by error-free instruments, with encoders after the gears; markers are in
    the base's frame, in m.
    """
    assert seen.link_posture is not None and seen.wrench_sensor is not None
    model, arm = rig.nominal, rig.anatomy
    rows = int(np.sum(seen.visit == seen.visit[0]))
    posture = seen.posture[::rows]
    bodies = [arm.body(marker.body) for marker in seen.markers]
    turn = np.zeros((len(posture), len(bodies), 3, 3))
    axis = np.zeros((len(posture), len(arm.axes), 3))
    origin, sensor = np.zeros_like(axis), np.zeros((len(posture), 3))
    sensor_turn = np.zeros((len(posture), 3, 3))
    data = mujoco.MjData(model)
    addresses = [int(model.joint(a).qposadr[0]) for a in arm.axes]
    for v, angles in enumerate(posture):
        data.qpos[addresses] = angles
        mujoco.mj_kinematics(model, data)
        base, world = data.body(arm.base).xpos, data.body(arm.base).xmat.reshape(3, 3)
        for k, name in enumerate(arm.axes):
            axis[v, k] = data.joint(name).xaxis @ world
            origin[v, k] = (data.joint(name).xanchor - base) @ world
        for m, body in enumerate(bodies):
            turn[v, m] = world.T @ data.body(body).xmat.reshape(3, 3)
        flange = data.body(arm.flange)
        sensor_turn[v] = world.T @ flange.xmat.reshape(3, 3)
        sensor[v] = (flange.xpos - base) @ world
        sensor[v] += sensor_turn[v] @ seen.wrench_sensor.position
    wind_up = (seen.link_posture - seen.posture).reshape(len(posture), rows, -1)
    felt = along_base(seen, sensor_turn)
    for k in np.flatnonzero(arm.slides):  # no second encoder; gravity on it is constant
        pushed = np.einsum("vri,vi->vr", felt[..., :3], axis[:, k])
        wind_up[:, :, k] = pushed / rig.springs[k]
    return ReadingSensitivity(
        point=point.reshape(len(posture), rows, -1, 3),
        turn=turn,
        axis=axis,
        origin=origin,
        wind_up=wind_up,
        beyond=_beyond(model, arm.links, bodies),
        slides=np.array(arm.slides),
        stiffness=rig.springs,
        sensor=sensor,
        sensor_turn=sensor_turn,
        felt=felt,
    )


def _beyond(
    model: mujoco.MjModel, links: tuple[str, ...], bodies: list[str]
) -> Bool[np.ndarray, "axes markers"]:
    found = np.zeros((len(links), len(bodies)), dtype=bool)
    for m, name in enumerate(bodies):
        for body in carriers_of(model, model.body(name).id):
            if (carrier := model.body(body).name) in links:
                found[links.index(carrier), m] = True
    return found


# --- Projection onto the nuisance columns ---------------------------------------------


@dataclass(frozen=True)
class Projection:
    """Projects nuisance columns and a common error of each visit out of signals.

    Attributes:
        nominal: Nuisance columns G of all visits.
        error: Columns U of each visit, in units of their own sigma.
        prior: Diagonal of P.
        inner: Factor of G'AG + P.
        shrink: (1 + U'U)^-1 of each visit.
        posture_index: Number of each visit's pose, from 0.
    """

    nominal: Float[np.ndarray, "visits n columns"]
    error: Float[np.ndarray, "visits n errors"]
    prior: Float[np.ndarray, " columns"]
    inner: tuple
    shrink: Float[np.ndarray, "visits errors errors"]
    posture_index: Int[np.ndarray, " visits"]

    def residual(self, signal: np.ndarray) -> tuple[float, Float[np.ndarray, " poses"]]:
        """Return the residual χ² of a signal, in total and by pose.

        The signal is of all visits, (visits, …), in sigmas.
        """
        asked = signal.reshape(len(self.posture_index), -1)
        told = np.einsum("vn,vnc->c", self._without_error(asked), self.nominal)
        fitted = cho_solve(self.inner, told)
        rest = asked - self.nominal @ fitted
        share = np.sum(rest * self._without_error(rest), axis=1)
        total = float(np.sum(share) + fitted @ (self.prior * fitted))
        return total, np.bincount(self.posture_index, share)

    def _without_error(self, values: np.ndarray) -> np.ndarray:
        across = np.einsum("vn,vnk->vk", values, self.error)
        inside = np.einsum("vkl,vl->vk", self.shrink, across)
        return values - np.einsum("vnk,vk->vn", self.error, inside)


def projection_of(
    nominal: np.ndarray,
    error: np.ndarray,
    prior: Float[np.ndarray, " columns"],
    pose: Int[np.ndarray, " visits"],
) -> Projection:
    """Return a projection, its normal equations factorised.

    Nuisance columns are (visits, …, columns) in sigmas per unit, common errors (visits,
    …, errors) in sigmas per sigma of the error, priors inverse variances of the
    columns' coefficients.
    """
    columns = nominal.reshape(len(nominal), -1, nominal.shape[-1])
    common = error.reshape(len(error), -1, error.shape[-1])
    turned = common.transpose(0, 2, 1)
    shrink = np.linalg.inv(np.eye(common.shape[2]) + turned @ common)
    mixed = turned @ columns
    flat = columns.reshape(-1, columns.shape[2])
    gram = flat.T @ flat + np.diag(prior)
    gram -= np.einsum("vkc,vkl,vld->cd", mixed, shrink, mixed, optimize=True)
    numbers = np.unique(pose, return_inverse=True)[1]
    return Projection(columns, common, prior, cho_factor(gram), shrink, numbers)


# --- Nuisance columns -----------------------------------------------------------------

PLACE, DECADE, UNKNOWN = 1e-2, 2.3, 1.0
"""Prior sigma of a marker's position in m, of ln stiffness, of an unknown frame in m or
rad. The rules call a position nominal within 1 mm: ten times that is flat over it."""


def nuisance_jacobian(
    rig: Rig, standing: ReadingSensitivity, known_frame: bool
) -> tuple[Float[np.ndarray, "visits rows markers 3 n"], Float[np.ndarray, " n"]]:
    """Return the columns of all nuisance parameters, and their prior precisions."""
    point = standing.point
    visits, rows, markers, _ = point.shape
    columns, sigma = [], []
    for axis in np.flatnonzero(rig.nominal.jnt_stiffness > 0.0):
        columns.append(standing.turned(int(axis))[..., None])
        sigma.append(np.array([DECADE]))
    if not known_frame:
        turns = np.stack([np.cross(e, point) for e in np.eye(3)], axis=-1)
        columns += [np.broadcast_to(np.eye(3), (*point.shape, 3)), turns]
        sigma.append(np.full(6, UNKNOWN))
    places = np.zeros((visits, rows, markers, 3, markers, 3))
    for m in range(markers):
        places[:, :, m, :, m] = standing.turn[:, None, m]
    columns.append(places.reshape(*point.shape, 3 * markers))
    sigma.append(np.full(3 * markers, PLACE))
    return np.concatenate(columns, axis=-1), np.concatenate(sigma) ** -2.0


# --- Visibility of an effect ----------------------------------------------------------


@dataclass(frozen=True)
class Visibility:
    """The size of an effect as χ², after the nuisance parameters were fitted to it.

    Attributes:
        within: χ² of differences within visits.
        between: χ² of means of visits.
        whole: χ² of both at once.
        poses: Effective number of poses: (Σ c)² / Σ c² of their shares c.
        left: χ² that the library's best names do not explain; None where not asked.
    """

    within: float
    between: float
    whole: float
    poses: float
    left: float | None = None

    @property
    def chi2(self) -> float:
        """The larger of `within` and `between`: the size of the effect."""
        return max(self.within, self.between)


@dataclass(frozen=True)
class Scale:
    """Computes visibility for one arm, plan and tracker.

    Attributes:
        reference: Recording without the effect, by error-free instruments.
        standing: Its kinematics and loads.
        to_white: Maps a displacement along the base's axes, in m, to sigmas.
        within: Projection of nuisance columns from differences within visits.
        between: The same from means of visits.
        whole: The same from all readings.
    """

    reference: Recording
    standing: ReadingSensitivity
    to_white: Float[np.ndarray, "3 3"]
    within: Projection
    between: Projection
    whole: Projection

    def visibility(self, seen: Recording) -> Visibility:
        """Return the visibility of an effect.

        It was seen on the same plan by the same instruments.
        """
        moved = in_base(seen) - in_base(self.reference)
        felt = self.standing.wrench(seen) - self.standing.wrench(self.reference)
        moved = (moved - self.standing.response(felt)) @ self.to_white
        moved = moved.reshape(self.standing.point.shape)
        within, shown = self.within.residual(_differences(moved))
        between, also = self.between.residual(_means(moved))
        share = shown if within > between else also
        spread = float(np.sum(share) ** 2 / max(np.sum(share**2), 1e-300))
        return Visibility(within, between, self.whole.residual(moved)[0], spread)


def scale_of(
    rig: Rig, reference: Recording, repeatability: tuple[float, ...], known_frame: bool
) -> Scale:
    """Prepare the projections of a plan.

    The reference was seen by error-free instruments with link encoders; one sigma of
    the tracker along its axes is in m.
    """
    assert reference.base_from_tracker is not None
    to_white = reference.base_from_tracker[:3, :3] / np.array(repeatability)
    standing = reading_sensitivity_of(rig, reference, in_base(reference))
    columns, prior = nuisance_jacobian(rig, standing, known_frame)
    nominal = _white(columns, to_white)
    force = _white(standing.force_errors(TURN, SIZE), to_white)
    pose = reference.posture_id[:: standing.point.shape[1]]
    free = np.flatnonzero(prior != PLACE**-2)  # places stay the same within a visit
    return Scale(
        reference,
        standing,
        to_white,
        projection_of(
            _differences(nominal[..., free]), _differences(force), prior[free], pose
        ),
        projection_of(_means(nominal), _means(force), prior, pose),
        projection_of(nominal, force, prior, pose),
    )


def in_base(recording: Recording) -> Float[np.ndarray, "rows markers 3"]:
    """Return the readings in the base's frame by the manifest's transform, in m."""
    frame = recording.base_from_tracker
    assert recording.points is not None and frame is not None
    return recording.points @ frame[:3, :3].T + frame[:3, 3]


def _white(
    columns: Float[np.ndarray, "visits rows markers 3 n"],
    to_white: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "visits rows markers 3 n"]:
    return np.einsum("vrmic,ij->vrmjc", columns, to_white, optimize=True)


def _differences(values: np.ndarray) -> np.ndarray:
    return values - values.mean(axis=1, keepdims=True)


def _means(values: np.ndarray) -> np.ndarray:
    """Return means over the rows of a visit, in their own sigmas."""
    return values.mean(axis=1, keepdims=True) * np.sqrt(values.shape[1])
