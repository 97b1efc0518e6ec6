"""Effects as mechanisms of the simulated arm: each file holds one physical deviation.

What to use when: `EFFECTS` are the ones that can be asked for by name; `OTHER_LAWS`
have the name of one of them but another mechanism, for trials in which the law is not
known; `bench.effects.parse` reads them from words. No method may import this package.
"""

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
from bench.effects.reading_lag import ReadingLag
from bench.effects.tracker_misalignment import TrackerMisalignment
from bench.effects.tracker_scale import TrackerScale
from bench.effects.transmission_error import TransmissionError
from bench.effects.wrench_bias import WrenchBias
from bench.effects.wrench_gain import WrenchGain
from bench.effects.wrench_misalignment import WrenchMisalignment
from bench.effects.wrist_coupling import WristCoupling
from bench.shared.effect_catalogue import CATALOGUE

__all__ = ["EFFECTS", "OTHER_LAWS"]

EFFECTS: tuple[type[Effect], ...] = (
    # in a gear
    JointCompliance,
    Hardening,
    AsymmetricStiffness,
    LostMotion,
    Hysteresis,
    Creep,
    AngleDependentStiffness,
    WristCoupling,
    # in bearings, links and the foot
    BearingTilt,
    LinkBending,
    BaseCompliance,
    # in weight
    GravityLoad,
    MassScale,
    GravityCompensator,
    DeflectionCompensation,
    # in geometry
    TransmissionError,
    EncoderOffset,
    ReadingLag,
    GeometryError,
    # in the rope
    PulleyFriction,
    # in an instrument
    WrenchBias,
    WrenchGain,
    WrenchMisalignment,
    TrackerScale,
    TrackerMisalignment,
    Drift,
    MarkerSlip,
)
"""One mechanism for each effect name of the vocabulary."""

OTHER_LAWS: tuple[type[Effect], ...] = (SmoothHardening, SmoothLostMotion, ManyContacts)
"""Alternative mechanisms under names that `EFFECTS` has."""

WITHOUT_MECHANISM = {"channel_delay"}
"""Names without a mechanism: a delay is visible in streams only, which the bench does
not record."""

if missing := {kind.name for kind in EFFECTS} - CATALOGUE.keys():
    raise ImportError(f"bench.shared.effect_catalogue.CATALOGUE has no {missing}.")
if missing := CATALOGUE.keys() - {kind.name for kind in EFFECTS} - WITHOUT_MECHANISM:
    raise ImportError(f"bench.effects.EFFECTS has no {missing}.")
