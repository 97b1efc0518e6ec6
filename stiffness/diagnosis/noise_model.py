"""Noise model: repeatability, wrench errors, rigid bodies of markers, outliers.

A controller brings each axis back nearly, never exactly, to where it was.

==========  ==========================================================================
Equation    sigma_k^2 = spread of the visits' own angles of axis k (robust), less their
            estimation error; angles q_v = (A'A)^-1 A'r of each visit after a smooth
            trend over posture, torque and time; at most sigma / lever of the data
            sheet, and what the encoders' stated noise leaves of a mean angle
Source      method of moments for a variance component; ISO 9283 for repeatability;
            0.02 mm at the flange as three sigma (Wu et al. 2024, section 3.1)
Valid       visits that err independently
Ignores     that an axis returns better from one side
==========  ==========================================================================

A wrong wrench mimics a deflection, row by row and visit by visit.

==========  ==========================================================================
Equation    turn_k = c_k J_k' dw;  dw = white noise per row;
            dw = [phi x F; phi x T] + g [F; T] with phi, g per visit
Source      propagation of errors, JCGM 100:2008, 5.2; sizes: the sensor's stated
            accuracy, or 0.3 degrees and 0.5 %, whichever is larger (chosen: what
            mounting and cables do to a careful measurement)
Valid       the fitted springs carry most of the deflection
Ignores     errors that stay the same over the whole recording: these are findings
==========  ==========================================================================

Three or more markers of a body show its motion; the residual is noise.

==========  ==========================================================================
Equation    y_mr = rest_m + G_m xi_r + noise: least squares over rest_m and xi_r of one
            body and visit; degrees of freedom: coordinates - 3 M - 6 (R - 1)
Source      least squares; "pure error" of a lack-of-fit test
Valid       bodies that stay rigid, three markers not on a line
Ignores     which rows a marker was missing in, when freedoms are counted
==========  ==========================================================================

A reading far beyond the noise counts less; none is dropped, and each is told.

==========  ==========================================================================
Equation    weight = frames min(1, (severe / size)^2), size = |reading - rigid motion|
            in sigma; measured noise^2 = sum of squares left / degrees of freedom
Source      Huber 1981, "Robust statistics"; pure error from rigid bodies
Valid       bodies with three markers or more
Ignores     an outlier on a body with fewer markers
==========  ==========================================================================

Marks of one body keep their distances in all poses; what they do not keep is noise.

==========  ==========================================================================
Equation    as of one visit above, all rows as one visit, along the body's axes; without
            one mark where that leaves clearly less
Source      as above
Valid       bodies with three marks or more; with four, of which one may sag
Ignores     that a tracker may be worse along one of its axes
==========  ==========================================================================

Marks that wander on their bodies for hours do so along no law.

==========  ==========================================================================
Equation    z_v = what a body's rigid motion leaves of a mark, mean over visit v, along
            its body's axes, white by differences of visits that follow each other;
            cov(z_v, z_u) = s^2 (delta_vu + rho exp(-|t_v - t_u| / tau)), s^2 at its
            best, rho and tau over a grid; asked for where its log Bayes factor by BIC
            is beyond `WANDERS` over z_v = a + b (1 - exp(-(t_v - t) / T)) + noise, t
            over all visits, T = 0 (a step) and over a grid
Source      Ornstein and Uhlenbeck 1930, "On the theory of the Brownian motion"; BIC:
            Schwarz 1978, "Estimating the dimension of a model"
Valid       bodies with three marks or more
Ignores     marks that wander together, as their body does; that noise of visits close
            in time is alike
==========  ==========================================================================

A tracker's volumetric error varies smoothly over its volume and does not average.

==========  ==========================================================================
Equation    cov f(p), f(p') = sd^2 mean_L exp(-|p - p'|^2 / (2 L^2)) by coordinate;
            f(p) = k(p, Z) k(Z, Z)^-1/2 a with a ~ N(0, 1), and what the anchors Z
            leave, k(p, p) - k(p, Z) k(Z, Z)^-1 k(Z, p), as noise of each place
Source      Nystroem method (Williams & Seeger 2001); its rest as noise (Snelson &
            Ghahramani 2006, "Sparse Gaussian processes using pseudo-inputs"); lengths L
            chosen: a third to all of an arm's workspace, since no maker states one
Valid       inside the measuring volume
Ignores     that what the anchors leave is alike at neighbouring places
==========  ==========================================================================
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.distance import cdist

from stiffness.effects.marker_slip import sagged
from stiffness.experiment.residuals import Residuals
from stiffness.experiment.sensor_noise import left_of_encoders
from stiffness.experiment.static_state import StaticState
from stiffness.experiment.visits import Visits, mean_of
from stiffness.regression.splits import k_means
from stiffness.robot.kinematics import point_jacobian

# --- Repeatability of the joints ------------------------------------------------------

AT_FLANGE = 0.02e-3 / 3
"""One sigma at the flange where nothing is stated, in m; a 10 kg arm's data sheet."""
SHORTEST_LEVER = 0.1
"""In m; chosen: a wrist's own size, for axes that go through the flange."""
ALIKE = 1e-4
"""Share by which smooth functions differ at least to be two; chosen: of less the last
digits of fitted springs would decide."""


def max_pose_repeatability(situation: StaticState) -> Float[np.ndarray, " axes"]:
    """Return the most by which a repeatable axis misses its posture, in rad or m."""
    tip = situation.arm.at(situation.rest).point("flange", np.zeros(3))
    arm = tip[:, None] - situation.origin[:, 1:]
    along = situation.frame[:, 1:, :, 2]
    lever = np.sqrt(np.mean(np.sum(np.cross(along, arm) ** 2, axis=2), axis=0))
    lever = np.where(situation.arm.slides, 1.0, np.maximum(lever, SHORTEST_LEVER))
    returned = AT_FLANGE / lever
    return np.hypot(returned, left_of_encoders(situation.recording))


def pose_repeatability_of(
    white: Float[np.ndarray, "visits n"],
    lever: Float[np.ndarray, "visits n axes"],
    trend: Float[np.ndarray, "visits terms"],
    largest: Float[np.ndarray, " axes"],
) -> Float[np.ndarray, " axes"]:
    """Estimate how well axes return, one sigma in rad.

    Args:
        white: Whitened mean residuals, without arrival in their covariance.
        lever: Whitened columns of a turn of each axis.
        trend: Smooth functions that effects, but not arrivals, may follow.
        largest: What must not be exceeded.
    """
    information = lever.swapaxes(1, 2) @ lever
    information += np.eye(information.shape[1]) * (0.1 / largest) ** 2
    inverse = np.linalg.inv(information)
    angle = np.einsum("vij,vnj,vn->vi", inverse, lever, white)
    variance = np.median(np.diagonal(inverse, axis1=1, axis2=2), axis=0)
    fit, _, rank, _ = np.linalg.lstsq(trend, angle, rcond=ALIKE)
    left = angle - trend @ fit
    freedom = max(1, len(left) - rank)
    spread = (1.4826 * np.median(np.abs(left), axis=0)) ** 2 * len(left) / freedom
    return np.minimum(np.sqrt(np.maximum(spread - variance, 0.0)), largest)


def trend_of(
    posture: Float[np.ndarray, "visits axes"],
    torque: Float[np.ndarray, "visits axes"],
    time: Float[np.ndarray, " visits"],
) -> Float[np.ndarray, "visits terms"]:
    """Return smooth functions of posture, torque and time, of size one."""
    terms = [np.ones((len(time), 1)), np.sin(posture), np.cos(posture), torque]
    stacked = np.column_stack([*terms, time])
    scale = np.max(np.abs(stacked), axis=0)
    stacked = stacked[:, scale > 0] / scale[scale > 0]
    return stacked[:, : max(1, len(time) // 4)]


# --- Errors of the wrench -------------------------------------------------------------

COMMON = 4
"""Errors that a whole visit shares: three turns of the force and a gain."""
TURN = np.deg2rad(0.3)
GAIN = 0.005


def induced_rotations(
    situation: StaticState, visits: Visits
) -> Float[np.ndarray, "visits turns errors"]:
    """Return the turns that one sigma of each error induces; index order axis, row.

    The first errors belong to the whole visit (`whole_visit_errors`: three turns of the
    force, a gain and unknown states of gears), six more to each row.
    """
    recording = situation.recording
    spec = recording.wrench_sensor
    rows, axes = situation.rest.shape
    stays, longest = visits.row.shape
    whole_visit = whole_visit_errors(situation)
    errors = np.zeros((stays, axes, longest, whole_visit + 6 * longest))
    end = COMMON
    for k, gear in situation.gears.items():
        if gear.unknown is not None:
            start, end = end, end + gear.unknown.shape[1]
            errors[:, k, :, start:end] = visits.gather(gear.unknown)
    if recording.wrench is None or spec is None:
        return errors[..., :whole_visit].reshape(stays, axes * longest, -1)
    jacobian = situation.arm.at(situation.rest).jacobian(spec.body, spec.position)
    give = jacobian.swapaxes(1, 2) * situation.compliance[:, None]  # (rows, axes, 6)
    force, torque = situation.wrench[:, :3], situation.wrench[:, 3:]
    strongest = max(float(np.max(np.linalg.norm(force, axis=1))), 1e-9)
    turn = max(TURN, spec.accuracy_force / strongest)
    gain = max(GAIN, spec.accuracy_force / strongest)
    whole = np.zeros((rows, 6, COMMON))
    for i in range(3):
        whole[:, :3, i] = turn * np.cross(np.eye(3)[i], force)
        whole[:, 3:, i] = turn * np.cross(np.eye(3)[i], torque)
    whole[:, :, 3] = gain * situation.wrench
    common = visits.gather(give @ whole)  # (visits, longest, axes, 4)
    own = visits.gather(give * spec.sigma)
    errors[..., :COMMON] = common.transpose(0, 2, 1, 3)
    for r in range(longest):
        first = whole_visit + 6 * r
        errors[:, :, r, first : first + 6] = own[:, r]
    return errors.reshape(stays, axes * longest, -1)


def whole_visit_errors(situation: StaticState) -> int:
    """Return how many errors of `induced_rotations` belong to a whole visit."""
    unknown = [gear.unknown for gear in situation.gears.values()]
    return COMMON + sum(x.shape[1] for x in unknown if x is not None)


# --- Rigid motion of a body -----------------------------------------------------------

MARKERS_OF_A_BODY = 3
"""Markers that fix a body's motion."""
SWEEPS = 5
"""Rest positions and motions are fitted in turn so often; chosen: each sweep gains a
factor of rows."""


def rigid_motion(
    residual: Float[np.ndarray, "visits rows markers 3"],
    weight: Float[np.ndarray, "visits rows markers"],
    inverse: Float[np.ndarray, "3 3"],
    point: Float[np.ndarray, "visits markers 3"],
    body: Int[np.ndarray, " markers"],
) -> tuple[
    Float[np.ndarray, "visits rows markers 3"],
    Bool[np.ndarray, "visits rows markers"],
    float,
]:
    """Fit rest positions and rigid motions of all bodies in all visits.

    Args:
        residual: Readings less where they should be; anything where weight is 0.
        weight: Of each reading.
        inverse: Inverse covariance of one frame's reading.
        point: Where markers are.
        body: Index of each marker's body.

    Returns:
        The fitted displacement of every marker in every row, seen or not; where it
        rests on enough markers to leave something over; and the degrees of freedom.
    """
    fitted = np.zeros_like(residual)
    checked = np.zeros(weight.shape, dtype=bool)
    freedom = 0.0
    for b in np.unique(body):
        own = np.flatnonzero(body == b)
        w, y = weight[:, :, own], residual[:, :, own]
        middle = point[:, own].mean(axis=1, keepdims=True)
        lever = point_jacobian(point[:, own] - middle)  # (visits, own, 3, 6)
        pull = lever.swapaxes(2, 3) @ inverse
        visits, rows, count = w.shape
        hessian = (pull @ lever).reshape(visits, count, 36)
        stiff = (w @ hessian).reshape(visits, rows, 6, 6)
        turn = np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
        stiff += (1e-6 * np.trace(inverse)) * (np.eye(6) + turn)
        inner = np.linalg.inv(stiff)
        total = w.sum(axis=1)
        total = np.where(total > 0, total, 1.0)[..., None]
        rest = (w[..., None] * y).sum(axis=1) / total
        flat = pull.transpose(0, 1, 3, 2).reshape(visits, 3 * count, 6)
        onto = lever.reshape(visits, 3 * count, 6).swapaxes(1, 2)
        moved = np.zeros_like(y)
        for _ in range(SWEEPS):
            ask = (w[..., None] * (y - rest[:, None])).reshape(visits, rows, -1) @ flat
            twist = (inner @ ask[..., None])[..., 0]
            moved = (twist @ onto).reshape(visits, rows, count, 3)
            rest = (w[..., None] * (y - moved)).sum(axis=1) / total
        fitted[:, :, own] = moved + rest[:, None]
        full = (w > 0).sum(axis=2) >= MARKERS_OF_A_BODY
        checked[:, :, own] = full[..., None] & (w > 0)
        lines = full.sum(axis=1)
        points = checked[:, :, own].sum(axis=(1, 2))
        free = 3 * points - 3 * count - 6 * np.maximum(lines - 1, 0)
        freedom += float(np.sum(np.where(lines > 1, free, 0)))
    return fitted, checked, max(freedom, 0.0)


# --- Outliers -------------------------------------------------------------------------

SEVERE = 4.5
"""Sigmas beyond which a reading counts less; chosen: three coordinates of a normal law
come there once in 7,000 readings, a slipped mark nearly always."""
USUAL, UNDERSTATED = 2.366, 1.2
"""Median of a chi-square of three coordinates; and the robust noise over the stated one
from which readings are judged by the former, chosen: else half of them count less."""
ENOUGH_READINGS = 50
"""Degrees of freedom from which the noise is measured; chosen: to a tenth."""


@dataclass(frozen=True)
class Checked:
    """Readings checked against each other.

    Attributes:
        weight: Of each reading.
        noise: Measured noise over the stated one; 1 where it cannot be measured.
        degrees_of_freedom: Degrees of freedom that it rests on.
        downweighted: Row, marker and size in sigma of each reading that counts less.
    """

    weight: Float[np.ndarray, "rows markers"]
    noise: float
    degrees_of_freedom: int
    downweighted: tuple[tuple[int, int, float], ...]


def checked(
    visits: Visits,
    residual: Float[np.ndarray, "rows markers 3"],
    point: Float[np.ndarray, "rows markers 3"],
    weight: Float[np.ndarray, "rows markers"],
    inverse: Float[np.ndarray, "3 3"],
    body: Int[np.ndarray, " markers"],
) -> Checked:
    """Compare readings with the rigid motion that the others of their body show.

    Args:
        visits: How rows lie side by side.
        residual: Reading less where it should be; NaN where not seen.
        point: The readings themselves.
        weight: Frames behind each.
        inverse: Inverse covariance of one frame's reading, as stated.
        body: Index of each marker's body.
    """
    own = visits.gather(weight) * visits.counts[..., None]
    values = np.nan_to_num(visits.gather(residual))
    place = mean_of(visits.gather(point), own)
    fitted, enough, freedom = rigid_motion(values, own, inverse, place, body)
    if freedom < ENOUGH_READINGS:
        return Checked(weight, 1.0, 0, ())
    left = np.where(enough[..., None], values - fitted, 0.0)
    size = np.sum((left @ inverse) * left, axis=3)[enough] * own[enough]
    usual = float(np.median(size)) / (USUAL * freedom / (3.0 * max(len(size), 1)))
    likely = inverse / usual if usual > UNDERSTATED**2 else inverse
    lighter = _lighter(left, own, likely)
    if np.any(lighter < own):
        fitted, _, _ = rigid_motion(values, lighter, inverse, place, body)
        left = np.where(enough[..., None], values - fitted, 0.0)
        lighter = _lighter(left, own, likely)
    square = float(np.sum((left @ inverse) * left * lighter[..., None]))
    new = weight.copy()
    new[visits.row[visits.counts]] = lighter[visits.counts]
    doubt = np.argwhere(new < weight)
    at = tuple(doubt.T)
    size = SEVERE * np.sqrt(weight[at] / np.maximum(new[at], 1e-12))
    doubtful = tuple(
        (int(r), int(m), float(s)) for (r, m), s in zip(doubt, size, strict=True)
    )
    return Checked(new, float(np.sqrt(square / freedom)), int(freedom), doubtful)


def _lighter(
    residual: Float[np.ndarray, "visits rows markers 3"],
    weight: Float[np.ndarray, "visits rows markers"],
    inverse: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "visits rows markers"]:
    size = np.sqrt(np.sum((residual @ inverse) * residual, axis=3) * weight)
    return weight * np.minimum(1.0, (SEVERE / np.maximum(size, SEVERE)) ** 2)


# --- Noise of a rigid body ------------------------------------------------------------

SAGS = 0.9
"""Noise without one mark over that with it, below which the mark moves on its body;
chosen."""


def with_noise_between_poses(
    check: Checked,
    situation: StaticState,
    readings: Residuals,
    marker_positions: Float[np.ndarray, "markers 3"],
    body: Int[np.ndarray, " markers"],
) -> Checked:
    """Return the same with noise measured between poses, where it was not within.

    Args:
        check: What readings within visits say of it.
        situation: Where the arm stood.
        readings: With their noise as stated.
        marker_positions: Of markers in their bodies' frames, in m.
        body: Index of each marker's body.
    """
    if check.degrees_of_freedom:
        return check
    values = _along_bodies(situation, readings)[None]
    own, alike = check.weight[None], np.eye(3) * np.trace(readings.inverse) / 3.0
    groups = [body]
    for mark in range(len(body)):  # as if it were a body of its own
        groups.append(np.where(np.arange(len(body)) == mark, -1, body))
    found = [
        _noise(values, own, alike, marker_positions[None], group) for group in groups
    ]
    noise, freedom = found[0]
    least = min((n for n, free in found if free >= ENOUGH_READINGS), default=noise)
    if freedom < ENOUGH_READINGS:
        return check
    noise = least if least < SAGS * noise else noise
    return replace(check, noise=noise, degrees_of_freedom=int(freedom))


def _noise(values, weight, inverse, marker_positions, body) -> tuple[float, float]:
    """Return measured noise over the stated one, and degrees of freedom."""
    fitted, enough, freedom = rigid_motion(
        values, weight, inverse, marker_positions, body
    )
    square = np.sum((values - fitted) ** 2, axis=3) * weight * inverse[0, 0]
    whole = float(np.sum(np.where(enough, square, 0.0)))
    return float(np.sqrt(whole / max(freedom, 1.0))), freedom


def _along_bodies(
    situation: StaticState, readings: Residuals
) -> Float[np.ndarray, "rows markers 3"]:
    """Return residuals along the axes of the markers' bodies, 0 where not seen."""
    standing = situation.arm.at(situation.rest)
    markers = situation.recording.markers
    turn = np.stack([standing.turn(m.body) for m in markers], axis=1)
    return np.einsum("rmij,rmi->rmj", turn, np.nan_to_num(readings.value))


# --- Marks that wander ----------------------------------------------------------------

WANDERS = 10.0
"""Log Bayes factor from which a mark wanders instead of slipping or sagging; chosen: as
`NOT_ALIKE` of names."""
NOTICED = 0.1
"""Variance of a wander over that of a visit's mean from which it counts; chosen."""
FEWEST_FOR_WANDER = 20
"""Visits from which a course is told from noise; chosen."""
MOST_FOR_WANDER = 150
"""Visits of which a course is asked for; means of several of more visits; for time."""
STEADY = 1.1
"""Variance of visits over half that of their differences up to which all is noise;
chosen: of noise it is 1, give or take a twentieth."""
LASTS = (0.01, 0.03, 0.1, 0.3, 1.0)
"""tau over the time of all visits; chosen."""
WANDER = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""rho, variance of the wander over that of noise; chosen."""
SAGGING = (0.03, 0.1, 0.3, 1.0)
"""T over the time that is left; chosen."""


def wander_of(
    situation: StaticState,
    visits: Visits,
    readings: Residuals,
    marker_positions: Float[np.ndarray, "markers 3"],
    body: Int[np.ndarray, " markers"],
) -> Float[np.ndarray, " markers"]:
    """Return the variance of a coordinate by which marks wander in m²; 0: they stay.

    Args:
        situation: Where the arm stood.
        visits: How rows lie side by side.
        readings: With their noise as measured.
        marker_positions: Of markers in their bodies' frames, in m.
        body: Index of each marker's body.
    """
    still = np.zeros(len(body))
    if situation.recording.displacement == "relative":
        return still
    values, weight = _along_bodies(situation, readings)[None], readings.weight[None]
    alike = np.eye(3) * np.trace(readings.inverse) / 3.0
    fitted, checked, _ = rigid_motion(
        values, weight, alike, marker_positions[None], body
    )
    own = visits.gather(weight[0] * checked[0]) * visits.counts[..., None]
    means = mean_of(visits.gather((values - fitted)[0]), own)
    time = situation.recording.time[visits.row[:, 0]]
    courses, of_body = [], np.bincount(body)[body]
    for m in range(len(body)):
        seen = np.flatnonzero(own[:, :, m].sum(axis=1) > 0.0)
        order = seen[np.argsort(time[seen], kind="stable")]
        courses.append(_course_of(time[order], means[order, m]))
    total = np.array([course.variance for course in courses])
    total /= np.maximum(1.0 - 2.0 / of_body, 1.0 / 3.0)  # the rest moves the body
    noise = 1.0 / (alike[0, 0] * np.maximum(own.sum(axis=1), 1e-12))
    noticed = total > NOTICED * np.median(noise, axis=0)
    worth = np.array([course.worth for course in courses]) * noticed
    alone, likely = worth > WANDERS, worth > 0.0
    if 2 * likely.sum() > len(worth) and worth.sum() > WANDERS:  # it is the tracker's
        return np.where(likely, total, np.median(total[likely]))
    return np.where(alone, total, still)


@dataclass(frozen=True)
class _Course:
    """How a mark moves on its body.

    Attributes:
        worth: Log Bayes factor of a wander over noise alone, a slip and a sag.
        variance: Of a coordinate by the wander, in m².
    """

    worth: float
    variance: float


def _course_of(
    time: Float[np.ndarray, " visits"], course: Float[np.ndarray, "visits 3"]
) -> _Course:
    """Return how a mark moves on its body.

    Args:
        time: Of the visits, in their order.
        course: Where the mark is on its body, in m.
    """
    if len(time) < FEWEST_FOR_WANDER or time[-1] <= time[0]:
        return _Course(0.0, 0.0)
    parts = np.array_split(np.arange(len(time)), min(len(time), MOST_FOR_WANDER))
    time = np.array([time[own].mean() for own in parts])
    course = np.stack([course[own].mean(axis=0) for own in parts])
    course = course - course.mean(axis=0)
    value, vector = np.linalg.eigh(np.cov(np.diff(course, axis=0).T) / 2.0)
    kept = value > 1e-6 * max(value[-1], 1e-300)
    white = course @ (vector[:, kept] / np.sqrt(value[kept]))
    if np.sum(white**2) <= STEADY * white.size:
        return _Course(0.0, 0.0)
    count, price = white.size, np.log(white.size)
    width = white.shape[1]

    def likelihood(square: float, log_det: float, numbers: int) -> float:
        own = count * np.log(max(square, 1e-300)) + width * log_det
        return -0.5 * (own + numbers * price)

    def of_law(law: Float[np.ndarray, " visits"], numbers: int) -> float:
        basis, _ = np.linalg.qr(np.column_stack([np.ones(len(time)), law]))
        left = white - basis @ (basis.T @ white)
        return likelihood(float(np.sum(left**2)), 0.0, width + numbers)

    still = likelihood(float(np.sum(white**2)), 0.0, 0)
    span, best, variance = time[-1] - time[0], -np.inf, 0.0
    for lasts in LASTS:
        like = np.exp(-np.abs(time[:, None] - time) / (lasts * span))
        of_like, modes = np.linalg.eigh(like)
        turned, one = modes.T @ white, modes.T @ np.ones(len(time))
        for rho in WANDER:
            size = 1.0 + rho * np.maximum(of_like, 0.0)
            middle = (one / size) @ turned / float((one**2 / size).sum())
            left = turned - one[:, None] * middle
            square = float(np.sum(left**2 / size[:, None]))
            own = likelihood(square, float(np.log(size).sum()), 2)
            if own > best:
                best = own
                variance = rho * square / count
    if best < still:
        return _Course(best - still, 0.0)
    laws = [(np.arange(len(time)) >= k).astype(float) for k in range(2, len(time) - 1)]
    named = max(still, *(of_law(law, 1) for law in laws))
    for start in time[time < time[-1]]:
        for share in SAGGING:
            named = max(named, of_law(sagged(time, start, share), 2))
    return _Course(best - named, variance * float(value.sum()) / 3.0)


# --- Volumetric error of the tracker --------------------------------------------------

LENGTHS = (0.35, 0.7, 1.4)
"""L over the arm's extent, in units of a metre; chosen, see above."""
ANCHORS = 120
"""Most anchors; chosen: about one every 0.2 m in the workspace of a 10 kg arm."""


def smooth_basis(
    point: Float[np.ndarray, "many 3"], sd: float
) -> Float[np.ndarray, "many anchors"]:
    """Return basis functions whose coefficients have a standard normal prior, in m.

    Args:
        point: Where the error is wanted, in m.
        sd: The stated size of the error, in m.
    """
    count = min(ANCHORS, max(4, len(point) // 8))
    some = point[:: max(1, len(point) // 4000)]
    anchors, _ = k_means(some, count, minit="points", rng=0, iter=5)
    value, vector = np.linalg.eigh(_kernel(anchors, anchors, sd))
    keep = value > 1e-8 * value[-1]
    return _kernel(point, anchors, sd) @ (vector[:, keep] / np.sqrt(value[keep]))


def rest_of(
    basis: Float[np.ndarray, "*places waves"], sd: float
) -> Float[np.ndarray, " *places"]:
    """Return the variance of the error that a basis leaves at each place, in m^2."""
    return np.maximum(sd**2 - np.sum(basis**2, axis=-1), 0.0)


def _kernel(a: np.ndarray, b: np.ndarray, sd: float) -> np.ndarray:
    square = cdist(a, b, "sqeuclidean")
    return sd**2 * np.mean([np.exp(-square / (2 * L * L)) for L in LENGTHS], axis=0)
