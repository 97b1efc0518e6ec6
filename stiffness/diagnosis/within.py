"""Within a visit a marker rests where it likes; what moves it is the load.

==========  ==========================================================================
Equation    y_mr = rest_m + G_m xi_br + noise; pull of the readings on each body =
            sum L_m (x) G_m' T^-1 y_m, less what the wrench's errors feigned
Source      Gauss-Markov with the rest positions marginalised
Valid       as `Information`
Ignores     as `Information`
==========  ==========================================================================
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from stiffness.diagnosis.contrasts import Contrasts
from stiffness.diagnosis.information import Information
from stiffness.diagnosis.signature import levers
from stiffness.diagnosis.visits import Kept, stretches


@dataclass(frozen=True, eq=False)
class Within:
    """What differences within visits say about twists, visit by visit.

    Attributes:
        weight: Of each reading.
        lever: What takes a twist to a marker's displacement.
        inverse: Inverse covariance of one frame's reading.
        body: Index of each marker's body.
        carried: Whether a place carries a body.
        screw: Twist of what an axis carries per radian along it.
        kernel: U (1 + U' information U)^-1 U' of the wrench's errors U.
        raw: Information between turns.
        turns: The same with the wrench's errors taken out.
        pull: Of the readings, without what the wrench's errors feigned.
        square: Whitened sum of squares of each visit's differences, the same taken out.
        freedom: How many differences of coordinates each visit has.
        kept: What is laid out for the visits asked for last.
    """

    weight: Float[np.ndarray, "visits rows markers"]
    lever: Float[np.ndarray, "visits markers 3 6"]
    inverse: Float[np.ndarray, "3 3"]
    body: Int[np.ndarray, " markers"]
    carried: Bool[np.ndarray, "places bodies"]
    screw: Float[np.ndarray, "visits rows axes 6"]
    kernel: Float[np.ndarray, "visits turns turns"]
    raw: Float[np.ndarray, "visits turns turns"]
    turns: Float[np.ndarray, "visits turns turns"]
    pull: Float[np.ndarray, "bodies visits n 1"]
    square: Float[np.ndarray, " visits"]
    freedom: Float[np.ndarray, " visits"]
    kept: Kept[Information] = field(default_factory=Kept[Information])

    @classmethod
    def of(
        cls,
        residual: Float[np.ndarray, "visits rows markers 3"],
        weight: Float[np.ndarray, "visits rows markers"],
        inverse: Float[np.ndarray, "3 3"],
        point: Float[np.ndarray, "visits markers 3"],
        body: Int[np.ndarray, " markers"],
        frame: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> "Within":
        """Compress readings to what they say about bodies.

        Args:
            residual: Reading less nominal place, along the base's axes, in m.
            weight: Of each reading: frames averaged, less where it is an outlier, 0
                where it was not seen.
            inverse: Inverse covariance of one frame's reading, along the base's axes.
            point: Where markers are in each visit, in m.
            body: Index of each marker's body.
            frame: `carried`, `screw` and noise: turns of the axes, one sigma, that the
                wrench's errors feign (visits, turns, errors), index order axis, row.
        """
        visits, rows, _ = weight.shape
        carried, screw, noise = frame
        turns, bodies = noise.shape[1], carried.shape[1]
        kernel, raw, on_turns = np.empty((3, visits, turns, turns))
        pull = np.zeros((bodies, visits, rows * 6, 1))
        square = np.empty(visits)
        lever = levers(point)
        for some in stretches(visits):
            info = Information(
                weight[some], lever[some], inverse, body, carried, screw[some]
            )
            u, own = noise[some], info.on_turns
            inner = np.eye(u.shape[2]) + u.swapaxes(1, 2) @ own @ u
            kernel[some] = u @ np.linalg.solve(inner, u.swapaxes(1, 2))
            raw[some], on_turns[some] = own, own - own @ kernel[some] @ own
            values = residual[some].transpose(0, 2, 1, 3)  # (visits, markers, rows, 3)
            contrast = np.ascontiguousarray(info.laplace.transpose(0, 3, 1, 2)) @ values
            asked = contrast @ (inverse @ info.lever)
            for b in range(bodies):
                of_body = asked[:, body == b].sum(axis=1)
                pull[b, some] = of_body.reshape(len(of_body), -1, 1)
            seen = Contrasts(info, kernel[some], own, on_turns[some], pull[:, some])
            along = seen.on_turns(seen.pull)
            feigned = np.sum(along * (kernel[some] @ along), axis=(1, 2))
            whole = np.sum(values * (contrast @ inverse), axis=(1, 2, 3))
            square[some] = whole - feigned
            pull[:, some] = seen.cleaned(seen.pull)
        freedom = 3.0 * np.maximum((weight > 0).sum(axis=1) - 1, 0).sum(axis=1)
        return cls(
            weight, lever, inverse, body, carried, screw,
            kernel, raw, on_turns, pull, square, freedom,
        )  # fmt: skip

    def some(self, visits: Int[np.ndarray, " some"]) -> Contrasts:
        """Return what differences within some visits say."""
        info = self.kept.of(visits, self._information)
        kernel, raw, turns = self.kernel[visits], self.raw[visits], self.turns[visits]
        return Contrasts(info, kernel, raw, turns, self.pull[:, visits])

    def _information(self, visits: Int[np.ndarray, " some"]) -> Information:
        return Information(
            self.weight[visits],
            self.lever[visits],
            self.inverse,
            self.body,
            self.carried,
            self.screw[visits],
        )

    def less(self, pull: np.ndarray, square: np.ndarray) -> "Within":
        """Return the same with another pull and whitened square."""
        return replace(self, pull=pull, square=square)
