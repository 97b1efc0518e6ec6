"""Within-visit model: free marker offsets, differences carry the load.

What differences within visits could tell of twists, whatever the readings are.

==========  ==========================================================================
Equation    information of a body: sum over its markers of L_m (x) G_m' T^-1 G_m, with
            L_m = diag(w) - w w'/sum(w) over rows (the rest position marginalised);
            of two places: sum over the bodies that both carry; less wrench noise U:
            information - information U (1 + U' information U)^-1 U' information
Source      Gauss-Markov with nuisance marginalised; Woodbury's identity
Valid       small motions of rigid bodies; noise of rows independent but for U
Ignores     the change of a tracker's smooth error over a few millimetres
==========  ==========================================================================

A turn has one number a row, a motion of a place six; index order axis, row for turns,
row, component for motions.

Differences within some visits pull at bodies; a column feels the pull where it acts.

==========  ==========================================================================
Equation    pull of a motion: information of each body times its motion, less that of
            the turns U (1 + U' information U)^-1 U' (pull on turns) which the wrench's
            errors would induce; product of two columns: the one's motion times the
            other's pull; of two turns at once from the information between turns
Source      as `FisherInformation`
Valid       as `FisherInformation`
Ignores     as `FisherInformation`
==========  ==========================================================================

Within a visit a marker rests where it likes; what moves it is the load.

==========  ==========================================================================
Equation    y_mr = rest_m + G_m xi_br + noise; pull of the readings on each body =
            sum L_m (x) G_m' T^-1 y_m, less what the wrench's errors induced
Source      Gauss-Markov with the rest positions marginalised
Valid       as `FisherInformation`
Ignores     as `FisherInformation`
==========  ==========================================================================
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from stiffness.effects.design_matrix import (
    DesignMatrix,
    Group,
    contract,
    contract_each,
)
from stiffness.experiment.visits import Kept, stretches
from stiffness.robot.kinematics import point_jacobian

# --- Fisher information ---------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class FisherInformation:
    """Information on twists in some visits, laid out when it is asked for.

    Attributes:
        weight: Of each reading.
        lever: What takes a twist to a marker's displacement.
        inverse: Inverse covariance of one frame's reading.
        body: Index of each marker's body.
        carried: Whether a place carries a body.
        screw: Twist of what an axis carries per radian along it.
    """

    weight: Float[np.ndarray, "visits rows markers"]
    lever: Float[np.ndarray, "visits markers 3 6"]
    inverse: Float[np.ndarray, "3 3"]
    body: Int[np.ndarray, " markers"]
    carried: Bool[np.ndarray, "places bodies"]
    screw: Float[np.ndarray, "visits rows axes 6"]

    @property
    def axes(self) -> int:
        """How many axes there are."""
        return self.screw.shape[2]

    @cached_property
    def laplace(self) -> Float[np.ndarray, "visits rows rows markers"]:
        """Weights of products of two rows, the rest position marginalised."""
        weight, rows = self.weight, self.weight.shape[1]
        total = weight.sum(axis=1)
        share = weight / np.where(total > 0, total, 1.0)[:, None]
        laplace = -weight[:, :, None] * share[:, None]
        laplace[:, range(rows), range(rows)] += weight
        return laplace

    @cached_property
    def on_rotations(self) -> Float[np.ndarray, "visits turns turns"]:
        """Raw information between the axes' turns."""
        visits, rows = self.screw.shape[:2]
        blocks = []
        for k in range(self.axes):
            onto = self.through(k + 1).reshape(visits, -1, rows, 6)
            blocks.append(np.einsum("vtrc,vrc->vtr", onto, self.screw[:, :, k]))
        return np.concatenate(blocks, axis=2)

    def through(self, site: int) -> Float[np.ndarray, "visits turns n"]:
        """Return the raw information between the axes' turns and a place's motions."""
        if site not in self._through:
            blocks = [self._turned(k, self.both(k + 1, site)) for k in range(self.axes)]
            self._through[site] = np.concatenate(blocks, axis=1)
        return self._through[site]

    def of(self, bodies: tuple[int, ...]) -> Float[np.ndarray, "visits n n"]:
        """Return the information on a motion that these bodies share."""
        if bodies not in self._sums:
            visits, rows = self.screw.shape[:2]
            if not bodies:
                total = np.zeros((visits, rows * 6, rows * 6))
            elif len(bodies) == 1:
                total = self._of_body(bodies[0])
            else:  # the bodies of nested places differ by one
                total = self.of(bodies[1:]) + self.of(bodies[:1])
            self._sums[bodies] = total
        return self._sums[bodies]

    def both(self, one: int, other: int) -> tuple[int, ...]:
        """Return the bodies that both places carry."""
        shared = self.carried[one] & self.carried[other]
        return tuple(int(b) for b in np.flatnonzero(shared))

    def _of_body(self, b: int) -> np.ndarray:
        own = np.flatnonzero(self.body == b)
        visits, rows = self.screw.shape[:2]
        lever = self.lever[:, own]
        hessian = lever.swapaxes(2, 3) @ self.inverse @ lever
        joined = self.laplace[..., own].reshape(visits, rows * rows, len(own))
        product = joined @ hessian.reshape(visits, len(own), 36)
        shaped = product.reshape(visits, rows, rows, 6, 6).transpose(0, 1, 3, 2, 4)
        return shaped.reshape(visits, rows * 6, rows * 6)

    def _turned(self, k: int, bodies: tuple[int, ...]) -> np.ndarray:
        if (k, bodies) not in self._rows:
            visits, rows = self.screw.shape[:2]
            shaped = self.of(bodies).reshape(visits, rows, 6, rows * 6)
            turned = (self.screw[:, :, None, k] @ shaped)[:, :, 0]
            self._rows[k, bodies] = turned
        return self._rows[k, bodies]

    @cached_property
    def _sums(self) -> dict[tuple[int, ...], np.ndarray]:
        return {}

    @cached_property
    def _rows(self) -> dict[tuple[int, tuple[int, ...]], np.ndarray]:
        return {}

    @cached_property
    def _through(self) -> dict[int, np.ndarray]:
        return {}


# --- Contrasts within visits ----------------------------------------------------------


@dataclass(frozen=True, eq=False)
class WithinVisitContrasts:
    """What differences within some visits say about twists.

    Attributes:
        information: What they could say.
        kernel: U (1 + U' information U)^-1 U' of the wrench's errors U.
        raw: Information between turns.
        rotation_information: The same with the wrench's errors taken out.
        weighted_residual: Of the readings, without what the wrench's errors induced.
    """

    information: FisherInformation
    kernel: Float[np.ndarray, "visits turns turns"]
    raw: Float[np.ndarray, "visits turns turns"]
    rotation_information: Float[np.ndarray, "visits turns turns"]
    weighted_residual: Float[np.ndarray, "bodies visits n 1"]

    def add_gram(
        self, columns: DesignMatrix, total: Float[np.ndarray, "*visits slots slots"]
    ) -> None:
        """Add the products of all slots; shifts have none.

        Args:
            columns: In these visits.
            total: What they are added to: of all visits, or of each.
        """
        self._of_rotations(columns, total)
        if columns.twists:
            self._of_twists(columns, total)

    def products(
        self, few: DesignMatrix, many: DesignMatrix
    ) -> Float[np.ndarray, "few slots"]:
        """Return the products of columns with the slots of others, over all visits."""
        total = np.zeros((len(few.column), len(many.column)))
        for group, pulled in self._scores_at(few, [*many.rotations, *many.twists]):
            visits, n, own = pulled.shape
            laid = group.values.reshape(visits, n, -1)
            total[:own, group.slots] = contract(pulled, laid)
        return few.joined(total.T).T

    def of_each(self, columns: DesignMatrix, weighted: np.ndarray) -> np.ndarray:
        """Return the products of pulls with slots: (visits, pulls, slots)."""
        shape = (weighted.shape[1], weighted.shape[3], len(columns.column))
        total = np.zeros(shape)
        for group, at in self._sites(columns, weighted):
            laid = group.values.reshape(*at.shape[:2], -1)
            total[:, :, group.slots] = at.swapaxes(1, 2) @ laid
        return total

    def displacement(
        self, columns: DesignMatrix
    ) -> Float[np.ndarray, "bodies visits n columns"]:
        """Return how columns move the bodies."""
        info = self.information
        visits, rows = info.screw.shape[:2]
        bodies = info.carried.shape[1]
        total = np.zeros((bodies, visits, rows, 6, columns.count))
        for group in columns.rotations:
            screw = info.screw[:, :, group.site, :, None]
            moved = screw * group.values[:, :, None]
            columns.add(total, info.carried[group.site + 1], group, moved)
        for group in columns.twists:
            columns.add(total, info.carried[group.site], group, group.values)
        return total.reshape(bodies, visits, rows * 6, -1)

    def raw_scores(self, displacement: np.ndarray) -> np.ndarray:
        """Return the pull of motions of bodies, what errors induce included."""
        info = self.information
        return np.stack([info.of((b,)) @ own for b, own in enumerate(displacement)])

    def centred_scores(self, weighted: np.ndarray) -> np.ndarray:
        """Return pulls without what the wrench's errors most likely induce."""
        info = self.information
        visits, rows = info.screw.shape[:2]
        induced = self.kernel @ self.on_rotations(weighted)
        shaped = induced.reshape(visits, info.axes, rows, 1, -1)
        moved = np.zeros((len(weighted), visits, rows, 6, weighted.shape[3]))
        for k in range(info.axes):
            moved[info.carried[k + 1]] += info.screw[:, :, k, :, None] * shaped[:, k]
        return weighted - self.raw_scores(moved.reshape(weighted.shape))

    def on_rotations(self, weighted: np.ndarray) -> np.ndarray:
        """Return pulls along all axes: (visits, turns, pulls)."""
        along = [self._along(k, weighted) for k in range(self.information.axes)]
        return np.concatenate(along, axis=1)

    def _along(self, k: int, weighted: np.ndarray) -> np.ndarray:
        info = self.information
        visits, rows = info.screw.shape[:2]
        total = weighted[info.carried[k + 1]].sum(axis=0)
        shaped = total.reshape(visits, rows, 6, -1)
        return (info.screw[:, :, None, k] @ shaped)[:, :, 0]

    def _sites(
        self, columns: DesignMatrix, weighted: np.ndarray
    ) -> Iterator[tuple[Group, np.ndarray]]:
        for group in columns.rotations:
            yield group, self._along(group.site, weighted)
        for group in columns.twists:
            on = self.information.carried[group.site]
            yield group, weighted[on].sum(axis=0)

    def _of_rotations(self, columns: DesignMatrix, gram: np.ndarray) -> None:
        """Add the products of turns with turns."""
        visits, rows = self.information.screw.shape[:2]
        end = columns.rotations[-1].slots.stop if columns.rotations else 0
        product = contract if gram.ndim == 2 else contract_each
        for i, near in enumerate(columns.rotations):
            one = slice(near.site * rows, near.site * rows + rows)
            pulled = np.empty((visits, rows, end - near.slots.start))
            for far in columns.rotations[i:]:
                other = slice(far.site * rows, far.site * rows + rows)
                at = slice(
                    far.slots.start - near.slots.start,
                    far.slots.stop - near.slots.start,
                )
                pulled[..., at] = self.rotation_information[:, one, other] @ far.values
            block = product(near.values, pulled)
            after = slice(near.slots.stop, end)
            gram[..., near.slots, near.slots.start : end] += block
            own = block[..., near.values.shape[2] :]
            gram[..., after, near.slots] += own.swapaxes(-1, -2)

    def _of_twists(self, columns: DesignMatrix, gram: np.ndarray) -> None:
        """Add the products of motions with turns and with motions."""
        info = self.information
        product = contract if gram.ndim == 2 else contract_each
        visits, rows = info.screw.shape[:2]
        own = slice(columns.twists[0].slots.start, columns.twists[-1].slots.stop)
        laid = [g.values.reshape(visits, rows * 6, -1) for g in columns.twists]
        through = [info.through(g.site) for g in columns.twists]
        along = np.concatenate(
            [t @ x for t, x in zip(through, laid, strict=True)], axis=2
        )
        induced = self.kernel @ along
        left = along - self.raw @ induced
        for near in columns.rotations:
            one = slice(near.site * rows, near.site * rows + rows)
            block = product(near.values, left[:, one])
            gram[..., near.slots, own] += block
            gram[..., own, near.slots] += block.swapaxes(-1, -2)
        gram[..., own, own] -= product(along, induced)
        for j, (far, y) in enumerate(zip(columns.twists, laid, strict=True)):
            pulled: dict[tuple[int, ...], np.ndarray] = {}
            for near, x in zip(columns.twists[: j + 1], laid, strict=False):
                bodies = info.both(near.site, far.site)
                if bodies not in pulled:
                    pulled[bodies] = info.of(bodies) @ y
                block = product(x, pulled[bodies])
                gram[..., near.slots, far.slots] += block
                if near is not far:
                    gram[..., far.slots, near.slots] += block.swapaxes(-1, -2)

    def _scores_at(
        self, columns: DesignMatrix, groups: Sequence[Group]
    ) -> Iterator[tuple[Group, np.ndarray]]:
        """Return what turns and motions pull at groups: (visits, n, slots)."""
        info = self.information
        visits, rows = info.screw.shape[:2]
        last = (*columns.rotations, *columns.twists)[-1:]
        slots = last[0].slots.stop if last else 0
        # turns beside those that the wrench's errors would induce, and what they pull
        net, along = np.zeros((2, visits, self.raw.shape[1], slots))
        for group in columns.rotations:
            one = slice(group.site * rows, group.site * rows + rows)
            net[..., group.slots] = -self.kernel @ (self.raw[:, :, one] @ group.values)
            net[:, one, group.slots] += group.values
        for group in columns.twists:
            laid = group.values.reshape(visits, 6 * rows, -1)
            pulled = info.through(group.site) @ laid
            along[..., group.slots] = pulled
            net[..., group.slots] = -self.kernel @ pulled
        along += self.raw @ net
        of_motions: dict[tuple[int, tuple[int, ...]], np.ndarray] = {}
        at_places: dict[int, np.ndarray] = {}
        for group in groups:
            if group.values.ndim == 3:
                yield group, along[:, group.site * rows : (group.site + 1) * rows]
                continue
            if group.site in at_places:
                yield group, at_places[group.site]
                continue
            pulled = info.through(group.site).swapaxes(1, 2) @ net
            for motion in columns.twists:
                bodies = info.both(motion.site, group.site)
                key = (motion.site, bodies)
                if key not in of_motions:
                    laid = motion.values.reshape(visits, 6 * rows, -1)
                    of_motions[key] = info.of(bodies) @ laid
                pulled[..., motion.slots] += of_motions[key]
            at_places[group.site] = pulled
            yield group, pulled


# --- Within ---------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class WithinVisitModel:
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
        rotation_information: The same with the wrench's errors taken out.
        weighted_residual: Of the readings, without what the wrench's errors induced.
        square: Whitened sum of squares of each visit's differences, the same taken out.
        degrees_of_freedom: How many differences of coordinates each visit has.
        kept: What is laid out for the visits asked for last, whatever the residual.
    """

    weight: Float[np.ndarray, "visits rows markers"]
    lever: Float[np.ndarray, "visits markers 3 6"]
    inverse: Float[np.ndarray, "3 3"]
    body: Int[np.ndarray, " markers"]
    carried: Bool[np.ndarray, "places bodies"]
    screw: Float[np.ndarray, "visits rows axes 6"]
    kernel: Float[np.ndarray, "visits turns turns"]
    raw: Float[np.ndarray, "visits turns turns"]
    rotation_information: Float[np.ndarray, "visits turns turns"]
    weighted_residual: Float[np.ndarray, "bodies visits n 1"]
    square: Float[np.ndarray, " visits"]
    degrees_of_freedom: Float[np.ndarray, " visits"]
    kept: Kept[WithinVisitContrasts] = field(default_factory=Kept[WithinVisitContrasts])

    @classmethod
    def of(
        cls,
        residual: Float[np.ndarray, "visits rows markers 3"],
        weight: Float[np.ndarray, "visits rows markers"],
        inverse: Float[np.ndarray, "3 3"],
        point: Float[np.ndarray, "visits markers 3"],
        body: Int[np.ndarray, " markers"],
        frame: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> "WithinVisitModel":
        """Compress readings to what they say about bodies.

        Args:
            residual: Reading less nominal place, along the base's axes, in m.
            weight: Of each reading: frames averaged, less where it is an outlier, 0
                where it was not seen.
            inverse: Inverse covariance of one frame's reading, along the base's axes.
            point: Where markers are in each visit, in m.
            body: Index of each marker's body.
            frame: `carried`, `screw` and noise: turns of the axes, one sigma, that the
                wrench's errors induce (visits, turns, errors), index order axis, row.
        """
        visits, rows, _ = weight.shape
        carried, screw, noise = frame
        turns, bodies = noise.shape[1], carried.shape[1]
        kernel, raw, on_turns = np.empty((3, visits, turns, turns))
        pull = np.zeros((bodies, visits, rows * 6, 1))
        square = np.empty(visits)
        lever = point_jacobian(point)
        for some in stretches(visits):
            info = FisherInformation(
                weight[some], lever[some], inverse, body, carried, screw[some]
            )
            u, own = noise[some], info.on_rotations
            inner = np.eye(u.shape[2]) + u.swapaxes(1, 2) @ own @ u
            kernel[some] = u @ np.linalg.solve(inner, u.swapaxes(1, 2))
            raw[some], on_turns[some] = own, own - own @ kernel[some] @ own
            values = residual[some].transpose(0, 2, 1, 3)  # (visits, markers, rows, 3)
            contrast = np.ascontiguousarray(info.laplace.transpose(0, 3, 1, 2)) @ values
            asked = contrast @ (inverse @ info.lever)
            for b in range(bodies):
                of_body = asked[:, body == b].sum(axis=1)
                pull[b, some] = of_body.reshape(len(of_body), -1, 1)
            seen = WithinVisitContrasts(
                info, kernel[some], own, on_turns[some], pull[:, some]
            )
            along = seen.on_rotations(seen.weighted_residual)
            induced = np.sum(along * (kernel[some] @ along), axis=(1, 2))
            whole = np.sum(values * (contrast @ inverse), axis=(1, 2, 3))
            square[some] = whole - induced
            pull[:, some] = seen.centred_scores(seen.weighted_residual)
        freedom = 3.0 * np.maximum((weight > 0).sum(axis=1) - 1, 0).sum(axis=1)
        return cls(
            weight, lever, inverse, body, carried, screw,
            kernel, raw, on_turns, pull, square, freedom,
        )  # fmt: skip

    def log_bayes_of(
        self,
        axis: int,
        turns: Float[np.ndarray, "visits rows states"],
        asked: Int[np.ndarray, " asked"],
    ) -> float:
        """Return how much better the residual goes with random turns of an axis.

        Log Bayes factor of normal residuals, whose covariance is known either way:
        (p' (1 + u' I u)^-1 p - log det(1 + u' I u)) / 2, p the pull along u, summed
        over the visits.

        Args:
            axis: Its index, counted from 0.
            turns: u, one sigma of each state.
            asked: The visits that are summed over.
        """
        found, rows = 0.0, turns.shape[1]
        own = slice(axis * rows, axis * rows + rows)
        for some in (asked[part] for part in stretches(len(asked))):
            u, seen = turns[some], self.some(some)
            across = u.swapaxes(1, 2)
            pull = across @ seen.on_rotations(seen.weighted_residual)[:, own]
            information = across @ seen.rotation_information[:, own, own] @ u
            inner = np.eye(u.shape[2]) + information
            gain = np.sum(pull * np.linalg.solve(inner, pull))
            found += float(gain - np.sum(np.linalg.slogdet(inner)[1])) / 2.0
        return found

    def some(self, visits: Int[np.ndarray, " some"]) -> WithinVisitContrasts:
        """Return what differences within some visits say."""
        laid = self.kept.of(visits, self._contrasts)
        return replace(laid, weighted_residual=self.weighted_residual[:, visits])

    def _contrasts(self, visits: Int[np.ndarray, " some"]) -> WithinVisitContrasts:
        information = FisherInformation(
            self.weight[visits],
            self.lever[visits],
            self.inverse,
            self.body,
            self.carried,
            self.screw[visits],
        )
        return WithinVisitContrasts(
            information,
            self.kernel[visits],
            self.raw[visits],
            self.rotation_information[visits],
            self.weighted_residual[:, visits],
        )

    def with_residual(
        self, weighted_residual: np.ndarray, square: np.ndarray
    ) -> "WithinVisitModel":
        """Return the same with another pull and whitened square."""
        return replace(self, weighted_residual=weighted_residual, square=square)
