"""How much of an effect is left to be seen once everything nominal was fitted to it.

==========  ==========================================================================
Equation    χ² = min over β of |W (s - G β)|² + |β/prior|², s the noise-free
            displacement, G what is fitted silently, W'W = (S + U U')^-1 with S the
            tracker's noise and U the error of a visit's force; Woodbury per visit
Source      generalised least squares; first-order kinematics (Siciliano et al. 2009,
            section 3.1)
Valid       small displacements
Ignores     white noise of the force sensor, which moves a marker by less than 5 % of
            the tracker's; readings that are hidden
==========  ==========================================================================

What is fitted silently: springs that the model has, marker places within 1 mm, the
tracker's frame where it is unknown; and per visit an error of the force of 0.3° and
0.5 %. Nothing here comes from the diagnosis.

Three sums: `within`, differences within visits, with a free rest position for every
visit and marker; `between`, means of visits; `whole`, both with one error of the force
for a visit, which is more than their sum. The size of an effect is the larger of the
first two, for a load's effects show in the one and geometry's in the other.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.instruments.force_sensor import SIZE, TURN
from bench.recording import Recording
from bench.rig import Rig
from scenarios.trials.projection import Projection, projection_of
from scenarios.trials.silent import PLACE, silent_columns
from scenarios.trials.standing import Standing
from scenarios.trials.stood import standing_of


@dataclass(frozen=True)
class Weight:
    """How large an effect is.

    Attributes:
        within: χ² of differences within visits.
        between: χ² of means of visits.
        whole: χ² of both at once.
        poses: How many poses contribute: (Σ c)² / Σ c² of their shares c.
        left: What the library's best names would leave of χ²; None where not asked.
    """

    within: float
    between: float
    whole: float
    poses: float
    left: float | None = None

    @property
    def chi2(self) -> float:
        """The size of the effect."""
        return max(self.within, self.between)


@dataclass(frozen=True)
class Scale:
    """Weighs displacements of one plan, watched by one tracker.

    Attributes:
        reference: The arm without the effect, seen by silent instruments.
        standing: Where it stood.
        to_white: Turns a displacement in the base's frame into sigmas.
        within: What is nominal in differences within visits.
        between: In means of visits.
        whole: In all readings.
    """

    reference: Recording
    standing: Standing
    to_white: Float[np.ndarray, "3 3"]
    within: Projection
    between: Projection
    whole: Projection

    def weigh(self, seen: Recording) -> Weight:
        """Weigh what an effect changed.

        Args:
            seen: The same plan with the effect, by the same silent instruments.
        """
        moved = in_base(seen) - in_base(self.reference)
        felt = self.standing.wrench(seen) - self.standing.wrench(self.reference)
        moved = (moved - self.standing.response(felt)) @ self.to_white
        moved = moved.reshape(self.standing.point.shape)
        within, shown = self.within.left(_differences(moved))
        between, also = self.between.left(_means(moved))
        share = shown if within > between else also
        spread = float(np.sum(share) ** 2 / max(np.sum(share**2), 1e-300))
        return Weight(within, between, self.whole.left(moved)[0], spread)


def scale_of(
    rig: Rig,
    reference: Recording,
    repeatability: tuple[float, ...],
    known_frame: bool,
) -> Scale:
    """Lay out what is fitted silently.

    Args:
        rig: The arm without the effect.
        reference: What silent instruments saw of it, after the gears too.
        repeatability: One sigma of the tracker along its axes, in m.
        known_frame: Whether the recording will state where the tracker stands.
    """
    assert reference.base_from_tracker is not None
    to_white = reference.base_from_tracker[:3, :3] / np.array(repeatability)
    standing = standing_of(rig, reference, in_base(reference))
    columns, prior = silent_columns(rig, standing, known_frame)
    nominal = _white(columns, to_white)
    force = _white(standing.force_errors(TURN, SIZE), to_white)
    pose = reference.pose[:: standing.point.shape[1]]
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
    """Return where the manifest's frame puts the readings in the base's frame, in m."""
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
