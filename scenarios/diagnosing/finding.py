"""Everything that the story, the report and the playback speak of, in one place."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.proof import Channel, Proof
from bench.proving.gauge import residual_of
from bench.proving.turns import torques_of, turns_of
from bench.recording import Recording
from scenarios.diagnosing.answer import Answer
from stiffness.diagnosis.diagnosis import Diagnosis

MICRO = 1e6


@dataclass(frozen=True)
class Finding:
    """A diagnosis with its proof.

    Attributes:
        recording: What was looked at.
        diagnosis: What was found.
        simulated: The nominal arm and the patched one in the simulator; None where the
            recording cannot be simulated.
        unproved: Why nothing was proved; empty where something was.
        replicates: Scatter of replicates along x, y, z of the tracker in m, and degrees
            of freedom; None without replicates.
        answer: What goes to diagnosis.json.
    """

    recording: Recording
    diagnosis: Diagnosis
    simulated: Proof | None
    unproved: str
    replicates: tuple[Float[np.ndarray, "3"], int] | None
    answer: Answer

    @property
    def proof(self) -> Proof | None:
        """The proof, where something was put into the simulator."""
        return None if self.unproved else self.simulated


@dataclass(frozen=True)
class Curves:
    """What each axis turned beyond the nominal arm, against its torque.

    Attributes:
        axes: Their names.
        torque: Of nominal springs, in N m.
        before: Turn that markers show beyond the nominal arm, in rad.
        law: The same of the patched arm, simulated and without noise.
        held: Rows that nothing was fitted to.
        visit: Of each row.
        slides: Whether each axis slides (then N, and m).
    """

    axes: tuple[str, ...]
    torque: Float[np.ndarray, "rows axes"]
    before: Float[np.ndarray, "rows axes"]
    law: Float[np.ndarray, "rows axes"]
    held: np.ndarray
    visit: np.ndarray
    slides: tuple[bool, ...]


def curves_of(simulated: Proof) -> Curves:
    """Return the residual per axis against torque, and the named law in it."""
    world, gauge = simulated.world, simulated.gauge
    seen, patched = world.see(simulated.nominal), world.see(simulated.patched)
    markers = len(world.recording.markers)
    shape = (world.replay.rows, markers, 3)
    before = residual_of(world, seen, gauge)[:, : 3 * markers].reshape(shape)
    after = residual_of(world, patched, gauge)[:, : 3 * markers].reshape(shape)
    assumed = simulated.nominal
    arm = assumed.rig.anatomy
    return Curves(
        axes=tuple(f"a{k + 1}" for k in range(len(world.order))),
        torque=torques_of(world, assumed, seen),
        before=turns_of(world, assumed, seen, before),
        law=turns_of(world, assumed, seen, before - after),
        held=np.isin(world.recording.pose, simulated.held_out),
        visit=world.replay.visit,
        slides=tuple(arm.slides[k] for k in world.order),
    )


@dataclass(frozen=True)
class Course:
    """What an axis did during one visit, from where the law begins.

    Attributes:
        torque: In N m.
        measured: Turn beyond the nominal arm, in rad.
        law: The same, simulated.
    """

    torque: Float[np.ndarray, " rows"]
    measured: Float[np.ndarray, " rows"]
    law: Float[np.ndarray, " rows"]


def courses_of(curves: Curves, name: str, count: int = 3) -> list[Course]:
    """Return the visits in which an axis' torque varies most, widest first."""
    k = curves.axes.index(name)
    torque, measured, law = curves.torque[:, k], curves.before[:, k], curves.law[:, k]
    stays = [np.flatnonzero(curves.visit == v) for v in np.unique(curves.visit)]
    stays.sort(key=lambda rows: -np.ptp(torque[rows]))
    found = []
    for rows in stays[:count]:  # means say nothing, so both have the same one
        offset = measured[rows].mean() - law[rows].mean() + law[rows[0]]
        found.append(
            Course(torque[rows], measured[rows] - offset, law[rows] - law[rows[0]])
        )
    return found


def channel_of(proof: Proof) -> tuple[Channel | None, str]:
    """Return the channel that is spoken of, and its unit times a million."""
    if proof.markers is not None:
        return proof.markers, "µm"
    return proof.angles, "µrad"
