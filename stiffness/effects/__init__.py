"""Hypotheses on effects that nominal models leave out: one effect and law per file."""

from bench.shared.effect_catalogue import CATALOGUE
from stiffness.effects.angle_dependent_stiffness import AngleDependentStiffness
from stiffness.effects.askew_base import AskewBase
from stiffness.effects.askew_tilt import AskewTilt
from stiffness.effects.asymmetric_stiffness import AsymmetricStiffness
from stiffness.effects.base import Hypothesis
from stiffness.effects.base_compliance import BaseCompliance
from stiffness.effects.base_tilt import BaseTilt
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.channel_delay import ChannelDelay
from stiffness.effects.creep import Creep
from stiffness.effects.deflection_compensation import DeflectionCompensation
from stiffness.effects.drift import Drift
from stiffness.effects.encoder_offset import EncoderOffset
from stiffness.effects.geometry_error import GeometryError
from stiffness.effects.gravity_compensator import GravityCompensator
from stiffness.effects.gravity_load import GravityLoad
from stiffness.effects.hardening import Hardening
from stiffness.effects.hardening_tilt import HardeningTilt
from stiffness.effects.hysteresis import Hysteresis
from stiffness.effects.joint_compliance import JointCompliance
from stiffness.effects.link_bending import LinkBending
from stiffness.effects.lost_motion import LostMotion
from stiffness.effects.marker_slip import MarkerSlip
from stiffness.effects.mass_scale import MassScale
from stiffness.effects.pulley_friction import PulleyFriction
from stiffness.effects.reading_lag import ReadingLag
from stiffness.effects.stretched_spring import StretchedSpring
from stiffness.effects.tracker_misalignment import TrackerMisalignment
from stiffness.effects.tracker_scale import TrackerScale
from stiffness.effects.transmission_error import TransmissionError
from stiffness.effects.unequal_bending import UnequalBending
from stiffness.effects.wrench_bias import WrenchBias
from stiffness.effects.wrench_gain import WrenchGain
from stiffness.effects.wrench_misalignment import WrenchMisalignment
from stiffness.effects.wrist_coupling import WristCoupling

HYPOTHESES: tuple[Hypothesis, ...] = (
    # in a gear
    JointCompliance(),
    Hardening(),
    AsymmetricStiffness(),
    LostMotion(),
    Hysteresis(),
    Creep(),
    AngleDependentStiffness(),
    WristCoupling(),
    # in bearings, links and the foot
    BearingTilt(),
    HardeningTilt(),
    AskewTilt(),
    LinkBending(),
    UnequalBending(),
    BaseTilt(),
    BaseCompliance(),
    AskewBase(),
    # in weight
    GravityLoad(),
    MassScale(),
    GravityCompensator(),
    StretchedSpring(),
    DeflectionCompensation(),
    # in geometry
    TransmissionError(),
    EncoderOffset(),
    ReadingLag(),
    GeometryError(),
    # in the rope and the force sensor
    PulleyFriction(),
    WrenchBias(),
    WrenchGain(),
    WrenchMisalignment(),
    # in what is seen, and when
    TrackerScale(),
    TrackerMisalignment(),
    Drift(),
    MarkerSlip(),
    ChannelDelay(),
)
"""Every hypothesis that can be named.

Laws may share a name: `BearingTilt`, `HardeningTilt` and `AskewTilt`; `BaseTilt`,
`BaseCompliance` and `AskewBase`; `LinkBending` and `UnequalBending`;
`GravityCompensator` and `StretchedSpring`.
"""

if missing := {law.effect for law in HYPOTHESES} - CATALOGUE.keys():
    raise ImportError(f"bench.shared.effect_catalogue.CATALOGUE has no {missing}.")
if missing := CATALOGUE.keys() - {law.effect for law in HYPOTHESES}:
    raise ImportError(f"stiffness.effects.HYPOTHESES has no {missing}.")
