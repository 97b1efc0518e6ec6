"""Fixtures and settings of all tests: one thread, fixed examples, a clean checkout."""

import os

# Before numpy and torch are imported: both read these once.
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OMP_WAIT_POLICY"] = "PASSIVE"
os.environ.setdefault("MPLBACKEND", "Agg")

from collections.abc import Iterator
from pathlib import Path

import mujoco
import pytest
from checked_shapes import check_sparingly
from hypothesis import HealthCheck, settings

check_sparingly()  # before anything of ours is imported

ROOT = Path(__file__).resolve().parents[1]

settings.register_profile(
    "house",
    derandomize=True,  # the same examples on every machine
    deadline=None,  # no test depends on how busy the machine is
    max_examples=25,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("house")


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def kr10() -> Path:
    """The model file of the KR10 R1100-2, the arm alone."""
    return ROOT / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml"


@pytest.fixture(scope="session", autouse=True)
def _mujoco_log(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Send MuJoCo's warnings to a temporary log, not to one in the working folder."""
    usual = mujoco.MjLogConfig.get()
    ours = mujoco.MjLogConfig.get()
    ours.logfile = str(tmp_path_factory.mktemp("mujoco") / "log.txt")
    ours.set()
    yield
    usual.set()
