"""What a signature says is what MuJoCo's mechanism of the same name does."""

from collections.abc import Mapping
from dataclasses import replace

import hypothesis_truth as truth
import numpy as np
import pytest
from numpy.testing import assert_allclose

from bench.effects.angle_dependent_stiffness import AngleDependentStiffness
from bench.effects.asymmetric_stiffness import AsymmetricStiffness
from bench.effects.base_compliance import BaseCompliance
from bench.effects.bearing_tilt import BearingTilt
from bench.effects.creep import Creep
from bench.effects.deflection_compensation import DeflectionCompensation
from bench.effects.drift import Drift
from bench.effects.effect import Effect
from bench.effects.encoder_offset import EncoderOffset
from bench.effects.geometry_error import GeometryError
from bench.effects.gravity_compensator import GravityCompensator
from bench.effects.gravity_load import GravityLoad
from bench.effects.hardening import Hardening
from bench.effects.hardening_smooth import SmoothHardening
from bench.effects.hysteresis import Hysteresis
from bench.effects.hysteresis_many import ManyContacts
from bench.effects.joint_compliance import JointCompliance
from bench.effects.link_bending import LinkBending
from bench.effects.lost_motion import LostMotion
from bench.effects.lost_motion_smooth import SmoothLostMotion
from bench.effects.marker_slip import MarkerSlip
from bench.effects.mass_scale import MassScale
from bench.effects.pulley_friction import PulleyFriction
from bench.effects.tracker_misalignment import TrackerMisalignment
from bench.effects.tracker_scale import TrackerScale
from bench.effects.transmission_error import TransmissionError
from bench.effects.wrench_bias import WrenchBias
from bench.effects.wrench_gain import WrenchGain
from bench.effects.wrench_misalignment import WrenchMisalignment
from bench.effects.wrist_coupling import WristCoupling
from bench.shared.recording import Payload, Recording
from stiffness.effects import HYPOTHESES
from stiffness.effects.jacobian import turn, values
from stiffness.effects.statics import reading, turned_load, wind_up
from stiffness.experiment.static_state import StaticState
from stiffness.experiment.visits import BEFORE, MEMORIES, NOTHING

SECOND_ORDER = 0.005
"""What may be left of a displacement. A turn of one axis changes the lever arms of the
load on all: about 100 N m/rad over the 50 kN m/rad of a spring; and small effects are
a hundredth of what the springs give already."""
PARAMETERS = 0.02
"""What parameters may err by: that, where columns are alike, several times."""
SLIP_TIME = 2000.0

# --- Laws in the same form -----------------------------------------------------------

EXACT = [
    # effect, shape, axes whose own spring is fitted with it
    (JointCompliance("a4", 2e-6), (), ""),
    (JointCompliance("a2", 2e-7), (), ""),
    (AsymmetricStiffness("a4", 1.1), (0.01,), "a4"),
    (AsymmetricStiffness("a2", 0.9), (0.1,), "a2"),
    (Creep("a2", 0.03, 20.0), (20.0, 0.0), "a2"),
    (Creep("a5", 0.03, 60.0), (60.0, 0.0), "a5"),
    (AngleDependentStiffness("a3", 0.01, 2.0, 1.0), (2.0,), "a3"),
    (AngleDependentStiffness("a4", 0.01, 3.0, -1.0), (3.0,), "a4"),
    (WristCoupling("a6", "a4", 5e-6), (4.0,), "a6 a4"),
    (WristCoupling("a5", "a4", -5e-6), (4.0,), "a5 a4"),
    (BearingTilt("a2", 1e-6, 5e-7, 0.1), (0.1,), ""),
    (BearingTilt("a5", 1e-6, 5e-7, -0.05), (-0.05,), ""),
    (LinkBending("link_2", 6.3e5, 4.7e5), (0.0,), ""),
    (LinkBending("link_4", 2.45e5, 1.82e5), (0.0,), ""),
    (LinkBending("link_2", 6.3e5, 4.7e5, marks_bend=1), (1.0,), ""),
    (LinkBending("link_3", 2.45e5, 1.82e5, marks_bend=1), (1.0,), ""),
    (BaseCompliance("base", 5e-7, 3e-7, 2e-7, 1e-8, 2e-8, 3e-8), (0.0,), ""),
    (
        BaseCompliance("base", 5e-7, 3e-7, 2e-7, 1e-8, 2e-8, 3e-8, 0.0, -0.1),
        (-0.1,),
        "",
    ),
    (GravityLoad("link_3", 0.5, 0.1, 0.03, 0.0), (), ""),
    (GravityLoad("link_4", 0.5, 0.1, 0.03, 0.05), (), ""),
    (GravityLoad("tool", 0.2, 0.1, 0.03, 0.05), (), ""),
    (MassScale("arm", 1.02), (), ""),
    (GravityCompensator("a2", 5.0, 0.4), (), ""),
    (GravityCompensator("a2", 5.0, 0.4, 0.5, 0.3), (0.4, 0.3), ""),
    (GravityCompensator("a3", 5.0, -2.0, -2.0, 0.6), (-2.0, 0.6), ""),
    (DeflectionCompensation("a2", 0.2), (), ""),
    (DeflectionCompensation("a5", 1.0), (), ""),
    (TransmissionError("a3", 1e-4, 2.0, 0.7), (2.0,), ""),
    (GeometryError("link_1", 1e-4, 2e-4, -1e-4, 1e-4, 2e-4, 3e-4), (), ""),
    (GeometryError("link_4", 1e-4, 2e-4, -1e-4, 1e-4, 2e-4, 3e-4), (), ""),
    (TrackerScale("tracker", 5e-5), (), ""),
    (TrackerMisalignment("tracker", 1e-4, 2e-4, 3e-4, 1e-4, 2e-4, -1e-4), (), ""),
    (Drift("tracker", 3e-5, 1e-5, 2e-5, 1e-5, 2e-5, 3e-5, 2e3), (2e3,), ""),
    (Drift("base", 3e-5, 1e-5, 2e-5, 1e-5, 2e-5, 3e-5, 9e3), (9e3,), ""),
    (MarkerSlip("marker:link2_a", 1e-5, 2e-5, 3e-5, SLIP_TIME), (SLIP_TIME,), ""),
]


def label(case: object) -> str:
    """Name a case by its effect."""
    return f"{case.name}@{case.where}" if isinstance(case, Effect) else ""


@pytest.mark.parametrize(("effect", "shape", "springs"), EXACT, ids=label)
def test_columns_are_what_the_mechanism_does(effect, shape, springs):
    done = truth.in_base(truth.recording(effect)) - truth.in_base(truth.recording())
    fit = Fit(truth.situation(), effect, np.array(shape, dtype=float), springs.split())
    left, _, found = fit.of(done)
    assert left < SECOND_ORDER
    near(found, with_moments(effect.parameters()))


@pytest.mark.parametrize(
    ("effect", "shape"),
    [
        (BearingTilt("a2", 1e-6, 5e-7, 0.1, 4e-7), 0.1),
        (BearingTilt("a4", 5e-7, 1e-6, 0.0, -6e-7), 0.0),
        (BaseCompliance("base", 3e-7, 5e-7, 2e-7, 1e-8, 2e-8, 3e-8, 2e-7, -0.1), -0.1),
        *(
            (LinkBending(f"link_{k}", 4e5, 5e5, 0.4, within), within)
            for k in (1, 2, 3, 4, 5)
            for within in (0, 1)
        ),
    ],
    ids=label,
)
def test_columns_are_what_springs_unequal_across_do(effect, shape):
    done = truth.in_base(truth.recording(effect)) - truth.in_base(truth.recording())
    law, at = truth.BY_NAME[effect.name], (effect.where, np.array([float(shape)]))
    design = truth.moved(truth.situation(), law.jacobian(truth.situation(), *at))
    design = design.reshape(-1, design.shape[3])
    size = np.linalg.norm(design, axis=0)
    found = np.linalg.lstsq(design / size, done.ravel())[0] / size
    left = np.linalg.norm(done.ravel() - design @ found) / np.linalg.norm(done)
    assert left < SECOND_ORDER
    near(law.parameters(truth.situation(), *at, found), effect.parameters())


@pytest.mark.parametrize(
    "effect",
    [
        BearingTilt("a2", 1e-6, 5e-7, 0.1, compliance_ratio=0.3, moment_nm=50.0),
        BearingTilt("a5", 4e-6, 5e-6, 0.0, compliance_ratio=0.0, moment_nm=3.0),
    ],
    ids=label,
)
def test_bearing_that_grows_stiffer_tilts_as_claimed_but_for_the_rounded_knee(effect):
    done = truth.in_base(truth.recording(effect)) - truth.in_base(truth.recording())
    shape = np.array([effect.centre_m, effect.compliance_ratio, effect.moment_nm])
    left, _, found = Fit(truth.situation(), effect, shape, []).of(done)
    assert left < 2 * SECOND_ORDER
    near(found, effect.parameters())


def test_torque_couples_wrist_axes_through_gears_that_harden():
    """Linear springs would make it half as large; the knee is rounded in the claim."""
    gears = [
        Hardening(a, stiffness_ratio=1.8, torque_nm=2.0, middle_share=1.0)
        for a in ("a4", "a6")
    ]
    effect, linear = WristCoupling("a6", "a4", 5e-6), truth.situation()
    both = truth.in_base(truth.recording(*gears, effect))
    done = both - truth.in_base(truth.recording(*gears))
    situation, knee = linear, np.array([2.0, 0.0])
    for k, axis in ((3, "a4"), (5, "a6")):
        extra = np.array([0.8 * linear.compliance[k]])
        law = truth.BY_NAME["hardening"]
        situation = law.acting(situation, axis, knee, extra)
    sizes = [
        Fit(s, effect, np.array([4.0]), ["a6", "a4"]).of(done)[2]
        for s in (linear, situation)
    ]
    flat, found = (size["compliance_rad_per_nm"] for size in sizes)
    assert flat < 0.6 * 5e-6
    assert found == pytest.approx(5e-6, rel=0.06)


def test_link_that_swings_about_a_level_axis_shows_moments_and_no_mass():
    effect = GravityLoad("link_2", 0.5, 0.2, 0.03, 0.05)
    done = truth.in_base(truth.recording(effect)) - truth.in_base(truth.recording())
    left, _, found = Fit(truth.situation(), effect, np.zeros(0), []).of(done)
    assert left < SECOND_ORDER
    assert found.keys() == {"moment_x_kg_m", "moment_y_kg_m"}
    near(found, {"moment_x_kg_m": 0.5 * 0.2, "moment_y_kg_m": 0.5 * 0.03})


# --- Laws in another form ------------------------------------------------------------


@pytest.mark.parametrize(
    ("effect", "about"),
    [
        (Hardening("a2", torque_nm=29.0), 0.15),
        (SmoothHardening("a2", torque_nm=29.0), 0.15),
        (Hardening("a5", torque_nm=3.9), 0.3),
        (SmoothHardening("a5", torque_nm=3.9), 0.3),
        (LostMotion("a1"), 0.05),
        (SmoothLostMotion("a1"), 0.05),
        (LostMotion("a5"), 0.1),
        (SmoothLostMotion("a5"), 0.15),
        (Hysteresis("a2"), 0.1),
        (ManyContacts("a2"), 0.25),
        (Hysteresis("a5"), 0.1),
        (ManyContacts("a5"), 0.25),
    ],
    ids=label,
)
def test_another_law_of_the_same_effect_is_alike_at_some_shape_of_the_grid(
    effect, about
):
    """Beyond what the axis' own spring explains: cosine above 0.95, about the size."""
    done = truth.in_base(truth.recording(effect)) - truth.in_base(truth.recording())
    situation = truth.situation()
    shapes = truth.BY_NAME[effect.name].shapes(situation, effect.where)
    fits = [Fit(situation, effect, shape, [effect.where]).of(done) for shape in shapes]
    _, cosine, found = max(fits, key=lambda fit: fit[1])
    assert cosine > 0.95
    asked = next(iter(effect.parameters()))
    assert_allclose(found[asked], effect.parameters()[asked], rtol=about)


@pytest.mark.parametrize(
    ("effect", "about"),
    [
        (Creep("a2", 0.03, 60.0), 0.05),
        (Creep("a5", 0.03, 60.0), 0.05),
        (Hysteresis("a2"), 0.1),
        (Hysteresis("a3"), 0.1),
        (ManyContacts("a3"), 0.25),
    ],
    ids=label,
)
@pytest.mark.parametrize("memory", ["forgotten", "carried"])
def test_what_a_gear_remembers_is_told_by_its_readings(effect, about, memory):
    """The right memory explains most, and with it sizes are about right."""
    done = truth.recording(effect, memory=memory)
    done = truth.in_base(done) - truth.in_base(truth.recording())
    situation = truth.situation()
    shapes = truth.BY_NAME[effect.name].shapes(situation, effect.where)
    if isinstance(effect, Creep):  # its grid of times is coarse
        shapes = np.array([(effect.time_s, memory) for memory in MEMORIES])
    fits = [Fit(situation, effect, shape, [effect.where]).of(done) for shape in shapes]
    best = max(range(len(shapes)), key=lambda i: fits[i][1])
    assert shapes[best][1] == {"forgotten": NOTHING, "carried": BEFORE}[memory]
    _, cosine, found = fits[best]
    assert cosine > 0.95
    asked = next(iter(effect.parameters()))
    assert_allclose(found[asked], effect.parameters()[asked], rtol=about)


@pytest.mark.parametrize(
    ("effect", "rival"),
    [
        (Hardening("a1", torque_nm=29.0), "lost_motion"),
        (SmoothHardening("a1", torque_nm=29.0), "lost_motion"),
        (Hardening("a5", torque_nm=3.9), "lost_motion"),
        (SmoothHardening("a5", torque_nm=3.9), "lost_motion"),
        (LostMotion("a1"), "hardening"),
        (SmoothLostMotion("a1"), "hardening"),
        (LostMotion("a5"), "hardening"),
    ],
    ids=label,
)
def test_play_and_hardening_are_not_taken_for_each_other(effect, rival):
    """The right name leaves less than half of what the other leaves, at any shape."""
    done = truth.in_base(truth.recording(effect)) - truth.in_base(truth.recording())
    situation = truth.situation()

    def left(name: str) -> float:
        shapes = truth.BY_NAME[name].shapes(situation, effect.where)
        sizes = np.geomspace(shapes[0, 0], shapes[-1, 0], 13)
        finer = [
            (size, *law) for law in {tuple(s[1:]) for s in shapes} for size in sizes
        ]
        return min(
            Fit(situation, effect, np.array(shape), [effect.where], name).of(done)[0]
            for shape in finer
        )

    assert left(effect.name) < 0.5 * left(rival)


# --- Faults of the force sensor and the rope -----------------------------------------


@pytest.mark.parametrize(
    "effect",
    [
        WrenchBias("wrench_sensor", 0.5, -0.3, 0.4, 0.02, 0.03, -0.04),
        WrenchGain("wrench_sensor", 0.01, -0.02, 0.015, 0.03, 0.02, 0.01),
        WrenchMisalignment("wrench_sensor", 1e-3, -2e-3, 1.5e-3),
    ],
    ids=label,
)
def test_false_wrench_lets_expect_what_the_arm_does_not_do(effect):
    left, found = feigned(effect, first_shape(effect))
    assert left < SECOND_ORDER
    near(found, effect.parameters())


def test_sensor_beside_its_place_lets_expect_what_the_arm_does_not_do():
    """It turns the soft wrist alone, which takes sensor and force along: 1 to 2 %."""
    shift = {"x_m": 1e-3, "y_m": -2e-3, "z_m": 4e-3}
    effect = replace(WrenchMisalignment("wrench_sensor").off(), **shift)
    left, found = feigned(effect, np.array([1.0]))
    assert left < 3 * SECOND_ORDER
    near(found, shift)


def first_shape(effect: Effect) -> np.ndarray:
    """Return the first shape of an effect's hypothesis."""
    return truth.BY_NAME[effect.name].shapes(truth.situation(), effect.where)[0]


def feigned(effect: Effect, shape: np.ndarray) -> tuple[float, Mapping[str, float]]:
    """Return what a fault's law leaves of what it feigns, and the parameters found."""
    situation = truth.situation_in(truth.recording(effect))
    done = truth.in_base(truth.recording()) - truth.expected(situation)
    left, _, found = Fit(situation, effect, shape, []).of(done)
    return left, found


def test_friction_of_the_pulley_shows_where_the_wrench_is_taken_from_the_hook():
    effect = PulleyFriction("rig", 0.02)
    hook = replace(truth.recording(effect), wrench=truth.recording().wrench)
    situation = truth.situation_in(hook)
    assert truth.BY_NAME["pulley_friction"].places(situation) == ("rig",)
    done = truth.in_base(hook) - truth.expected(situation)
    left, _, found = Fit(situation, effect, np.zeros(0), []).of(done)
    assert left < SECOND_ORDER
    near(found, effect.parameters())


def test_friction_of_the_pulley_has_no_place_where_a_sensor_feels_the_rope():
    """Neither beside friction nor, where there is none, beside the sensor's noise."""
    silent = truth.recording()
    assert silent.wrench is not None
    noise = 0.04 * np.random.default_rng(0).standard_normal(silent.wrench.shape)
    grainy = replace(silent, wrench=silent.wrench + noise)
    for felt in (truth.recording(PulleyFriction("rig", 0.02)), grainy):
        situation = truth.situation_in(felt)
        assert truth.BY_NAME["pulley_friction"].places(situation) == ()


# --- Streams -------------------------------------------------------------------------

DELAY = 1e-3
"""In s; so short that its square plays no part."""


@pytest.mark.parametrize(("where", "channel"), [("wrench_sensor",) * 2, ("a3", "2")])
def test_channel_that_lags_lets_expect_the_arm_where_it_was(where, channel):
    late = truth.swinging(DELAY, channel)
    done = truth.expected(truth.swinging()) - truth.expected(late)
    delayed(where, late, done)


def test_tracker_that_lags_sees_the_arm_where_it_was():
    now, point = truth.swinging(), truth.expected(truth.swinging())
    speed = np.gradient(point, now.recording.time, axis=0)
    delayed("tracker", now, -DELAY * speed)


def delayed(where: str, situation: StaticState, done: np.ndarray) -> None:
    """Compare all but the ends, where a difference has one side only."""
    hypothesis = truth.BY_NAME["channel_delay"]
    signature = hypothesis.jacobian(situation, where, np.zeros(0))
    said = DELAY * truth.moved(situation, signature)[..., 0]
    inner = slice(1, -1)
    left = np.linalg.norm((done - said)[inner]) / np.linalg.norm(done[inner])
    assert left < SECOND_ORDER


# --- What goes with the arm ----------------------------------------------------------


@pytest.mark.parametrize("frame", ["sensor", "base"])
@pytest.mark.parametrize("axis", ["a2", "a4", "a6"])
def test_load_is_felt_as_the_sensor_says_where_an_axis_has_an_offset(axis, frame):
    """What differs within visits, turned lever arms of each row taken into account."""
    effect, usual = EncoderOffset(axis, 1e-3), truth.recording()
    seen = truth.recording(effect)
    if frame == "base":
        usual, seen = along_base(usual, 0.0, axis), along_base(seen, 1e-3, axis)
    situation = truth.situation_in(usual)
    done = truth.unexplained(seen) - truth.unexplained(usual)
    fit = Fit(situation, effect, np.zeros(0), [])
    left, _, found = fit.of(done)
    assert left < SECOND_ORDER
    near(found, effect.parameters())
    k = situation.axis(axis)
    loaded = wind_up(
        situation, turned_load(situation, k, situation.screw[:, k, :, None])
    )
    said = truth.moved(situation, loaded)[..., 0] + levers_of_rows(situation, k)
    said, done = within_visits(effect.offset_rad * said), within_visits(done)
    assert np.linalg.norm(done - said) < 0.03 * np.linalg.norm(done)


def along_base(recording: Recording, offset: float, axis: str) -> Recording:
    """State the wrench along the base's axes, the offset of an axis known.

    It is exact, and says so: what the offset does to it is less than usual noise.
    """
    posture = recording.posture.copy()
    posture[:, truth.situation().axis(axis)] += offset
    situation = truth.situation_in(replace(recording, posture=posture))
    sensor = recording.wrench_sensor
    assert sensor is not None
    return replace(
        recording,
        wrench=situation.wrench,
        wrench_sensor=replace(
            sensor, frame="base", accuracy_force=1e-6, accuracy_torque=1e-7
        ),
    )


def levers_of_rows(situation: StaticState, axis: int) -> np.ndarray:
    """Return the displacement per rad of an axis, lever arms as in each row, in m."""
    standing = situation.arm.at(situation.rest)
    each = []
    for marker in situation.recording.markers:
        assert marker.position is not None
        each.append(standing.jacobian(marker.body, marker.position)[:, :3, axis])
    return np.stack(each, axis=1)


def test_turn_that_stays_the_same_shows_no_load():
    """Lever arms go with what carries them, under load as well."""
    situation = truth.situation()
    constant = turn(2, np.ones(situation.rows))
    assert_allclose(within_visits(truth.moved(situation, constant)), 0.0, atol=1e-12)


def test_guide_of_a_slide_tilts_where_it_stands(tmp_path):
    """Wherever its carriage is: the tilt turns about the same point of the base."""
    situation = truth.palletiser(tmp_path)
    place = situation.axis("a3") + 1
    tilt = truth.BY_NAME["bearing_tilt"].jacobian(situation, "a3", np.array([0.05]))
    [part] = tilt.parts
    out = situation.recording.posture[:, place - 1] - 0.05
    guide = situation.origin[:, place] - out[:, None] * situation.seat[:, place, :, 2]
    moved = truth.at_point(values(part), guide)
    assert_allclose(moved, 0.0, atol=1e-12 * np.abs(values(part)).max())


def within_visits(moved: np.ndarray) -> np.ndarray:
    """Return displacements less their mean over each visit."""
    visit = truth.situation().visit
    mean = np.stack([moved[visit == v].mean(axis=0) for v in range(visit.max() + 1)])
    return moved - mean[visit]


# --- The comparison ------------------------------------------------------------------


class Fit:
    """Least squares of a displacement over a signature and what is fitted silently."""

    def __init__(
        self,
        situation: StaticState,
        effect: Effect,
        shape: np.ndarray,
        springs: list[str],
        name: str = "",
    ):
        """Lay out the columns of the effect, or of a name, and of axes' springs."""
        self.situation, self.shape, self.where = situation, shape, effect.where
        laws = [law for law in HYPOTHESES if law.effect == (name or effect.name)]
        self.hypothesis = next(
            law for law in laws if len(law.shape_names) == len(shape) or law.is_sum
        )
        self.axes = [situation.axis(a) for a in springs]
        own = self.hypothesis.jacobian(situation, self.where, shape)
        winding = [situation.wound(k, situation.torque[:, k]) for k in self.axes]
        silent = [
            turn(k, situation.softness_of(k) * torque)
            for k, torque in zip(self.axes, winding, strict=True)
        ]
        self.columns = own.columns
        design = [truth.moved(situation, s) for s in (own, *silent)]
        design = np.concatenate(design, axis=3)
        self.design = design.reshape(-1, design.shape[3])

    def of(self, done: np.ndarray) -> tuple[float, float, Mapping[str, float]]:
        """Return what is left, a cosine beside the silent columns, and parameters."""
        size = np.linalg.norm(self.design, axis=0)
        design, asked = self.design / size, done.ravel()
        found = np.linalg.lstsq(design, asked)[0]
        left = asked - design @ found
        own, silent = design[:, : self.columns], design[:, self.columns :]
        beside = asked - silent @ np.linalg.lstsq(silent, asked)[0]
        cosine = np.sqrt(1.0 - (left @ left) / (beside @ beside))
        found = found / size
        compliance = self.situation.compliance.copy()
        compliance[self.axes] += found[self.columns : self.columns + len(self.axes)]
        parameters = self.hypothesis.parameters(
            self.situation.with_compliance(compliance),
            self.where,
            self.shape,
            found[: own.shape[1]],
        )
        share = float(np.linalg.norm(left) / np.linalg.norm(asked))
        return share, float(cosine), parameters


def with_moments(true: Mapping[str, float | str]) -> dict[str, float | str]:
    """Return parameters, of a mass with its first moments."""
    moments = {
        f"moment_{axis}_kg_m": float(true["mass_kg"]) * float(true[f"com_{axis}_m"])
        for axis in ("xyz" if "mass_kg" in true else "")
    }
    return {**true, **moments}


def near(found: Mapping[str, float], true: Mapping[str, float | str]) -> None:
    """Compare parameters, `with` by its axis' number."""
    assert found
    for name, value in found.items():
        asked = true[name]
        if isinstance(asked, str):
            assert value == int(asked[1:])
        else:
            assert_allclose(value, asked, rtol=PARAMETERS, err_msg=name)


@pytest.mark.parametrize("name", ["wrench_misalignment", "wrench_bias", "wrench_gain"])
def test_sensor_errs_along_its_own_axes_whichever_axes_its_readings_have(name):
    """A controller that turns readings to the base turns their errors as well."""
    own, turned = (truth.situation_in(seen) for seen in _reported_both_ways())
    fault = truth.BY_NAME[name]
    for shape in fault.shapes(own, "wrench_sensor"):
        one, other = (
            truth.moved(s, fault.jacobian(s, "wrench_sensor", shape))
            for s in (own, turned)
        )
        assert_allclose(one, other, rtol=1e-3, atol=1e-6 * np.abs(one).max())


def test_sensor_errs_in_all_that_it_feels_the_tool_s_weight_included():
    """But for how the sensor turns with the arm under the load: 4 N m by 6e-3 rad."""
    seen = truth.recording()
    assert seen.wrench_sensor is not None and seen.wrench is not None
    felt = replace(seen.wrench_sensor, includes_tool_weight=True)
    tool = Payload(3.0, np.array([0.02, -0.05, 0.1]))
    with_tool = replace(seen, tool=tool, wrench_sensor=felt)
    found = reading(truth.situation_in(with_tool))
    assert_allclose(found, seen.wrench, atol=3e-2)


def _reported_both_ways() -> tuple[Recording, Recording]:
    seen = truth.recording()
    assert seen.wrench_sensor is not None
    sensor = replace(seen.wrench_sensor, frame="base")
    wrench = truth.situation_in(seen).wrench
    return seen, replace(seen, wrench=wrench, wrench_sensor=sensor)
