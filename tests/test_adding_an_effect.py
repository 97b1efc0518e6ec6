"""Follows the recipe of bench/README.md in a copy of the tree, with a belt drive."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

MECHANISM = '''\
"""Belt ratio: a belt drive turns its axis a share more than its pulleys say.

==========  ==========================================================================
Equation    q = q_reported (1 + ratio)
Source      a belt runs at the radius of its tension member, not of the pulley; size
            chosen: 0.03 mm on a radius of 60 mm
Valid       at rest
Ignores     slip of the belt under load
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.effects.effect import Command, CommandEffect
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class BeltRatio(CommandEffect):
    """A belt whose ratio is not that of its pulleys.

    Attributes:
        ratio: Share by which the axis turns too far.
    """

    name: ClassVar[str] = "belt_ratio"
    ratio: float = 5e-4

    @override
    def command(
        self, posture: Float[np.ndarray, "visits axes"], nominal: Command, arm: Anatomy
    ) -> Command:
        axis = arm.axes.index(arm.axis(self.where))
        reference = np.zeros_like(posture)
        reference[:, axis] = self.ratio * posture[:, axis]
        return Command(reference, np.zeros_like(posture))
'''
HYPOTHESIS = '''\
"""Belt ratio: an error of the axis' angle in proportion to the angle.

==========  ==========================================================================
Equation    angle of the link = reported angle q + ratio q + wind-up
Source      a belt runs at the radius of its tension member, not of the pulley
Valid       absolute readings of an axis that turns
Ignores     that a force sensor beyond the axis is turned with it
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, absolute, still
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.experiment.static_state import StaticState


@dataclass(frozen=True)
class BeltRatio(Hypothesis):
    """An axis that turns a share too far."""

    effect: ClassVar[str] = "belt_ratio"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"ratio": (-0.05, 0.05)}
    magnitudes: ClassVar[tuple[str, ...]] = ("ratio",)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        if not absolute(situation):
            return ()
        return tuple(a for k, a in enumerate(situation.axes) if not still(situation, k))

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        return turn(k, situation.recording.posture[:, k])

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        return {"ratio": coefficients[0]}
'''
FILES = {
    "bench/effects/belt_ratio.py": MECHANISM,
    "stiffness/effects/belt_ratio.py": HYPOTHESIS,
}
CATALOGUE = "bench/shared/effect_catalogue.py"
EFFECTS = "bench/effects/__init__.py"
HYPOTHESES = "stiffness/effects/__init__.py"
IMPORT = "import BeltRatio\n"
ENTRIES = {
    CATALOGUE: {
        '    EffectInfo(\n        "encoder_offset",': """\
    EffectInfo(
        "belt_ratio",
        "geometry",
        ("axis",),
        _magnitudes("ratio", -1e-3, 1e-3, CHOSEN),
        ("angle",),
        MEANS,
        "the axis turns a share too far",
        largest=1e-2,
    ),
"""
    },
    EFFECTS: {
        "from bench.effects.creep": f"from bench.effects.belt_ratio {IMPORT}",
        "    EncoderOffset,\n": "    BeltRatio,\n",
    },
    HYPOTHESES: {
        "from stiffness.effects.channel": f"from stiffness.effects.belt_ratio {IMPORT}",
        "    EncoderOffset(),\n": "    BeltRatio(),\n",
    },
}
"""What each list gets, by what it is put before."""
USE = """
import json
from pathlib import Path

from bench.effects.parse import parse
from bench.experiment import record
from bench.model_file import load
from bench.patch import effect_of, named
from bench.proof.proof import prove
from bench.rig import Rig
from bench.shared.plan import parse_path
from bench.standard_plans import tour
from scenarios.pipelines.diagnosis import answer_of, proved
from scenarios.pipelines.inputs import arm_of
from stiffness.diagnosis.diagnose import diagnose

model = Path("mjcf/kr10_r1100_2/kr10_r1100_2.xml")
effect = parse("belt_ratio@a2,ratio=3e-4", load(model))
assert effect_of(named(effect)) == effect
rig = Rig(model, (effect,))
plan = tour(rig, 30, parse_path("0,5,10,5,0"), 0, 0)
recording = record(rig, plan, seed=0)
arm = arm_of(model)
found = diagnose(recording, arm)
proof, why = proved(found, recording, arm, model)
answer = answer_of(found, proof, why, (), 0.0)
(name,) = answer.named
(place,) = answer.located
print(json.dumps({
    "verdict": answer.verdict,
    "named": [name.effect, name.where],
    "depends_on": place.depends_on,
    "ratio": [name.parameters["ratio"].low, name.parameters["ratio"].high],
    "patch": [[e.effect, e.where] for e in proof.patch.effects],
}))
"""


def follow(recipe: Path, root: Path, without: str = "") -> Path:
    """Copy the tree and add the effect, but for the entry in one list."""
    skip = shutil.ignore_patterns("__pycache__", "*.png")
    for folder in ("bench", "stiffness", "scenarios", "mjcf"):
        shutil.copytree(root / folder, recipe / folder, ignore=skip)
    for file, text in FILES.items():
        (recipe / file).write_text(text, "utf-8")
    for file, entries in ENTRIES.items():
        if file == without:
            continue
        text = (recipe / file).read_text("utf-8")
        for before, entry in entries.items():
            assert text.count(before) == 1, (file, before)
            text = text.replace(before, entry + before)
        (recipe / file).write_text(text, "utf-8")
    return recipe


def run(tree: Path, program: str) -> subprocess.CompletedProcess:
    """Run a program in a tree."""
    environment = os.environ | {"PYTHONPATH": str(tree)}
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=tree,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_an_effect_is_two_files_and_an_entry_in_three_lists(root, tmp_path):
    """It is then recorded, diagnosed, named with its size, patched and proved."""
    done = run(follow(tmp_path, root), USE)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    low, high = answer.pop("ratio")
    assert low < 3e-4 < high
    assert high - low < 3e-5
    assert answer == {
        "verdict": "explained",
        "named": ["belt_ratio", "a2"],
        "depends_on": ["angle"],
        "patch": [["belt_ratio", "a2"]],
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("missing", "package", "named"),
    [
        (CATALOGUE, "bench.effects", "bench.shared.effect_catalogue.CATALOGUE"),
        (CATALOGUE, "stiffness.effects", "bench.shared.effect_catalogue.CATALOGUE"),
        (EFFECTS, "bench.effects", "bench.effects.EFFECTS"),
        (HYPOTHESES, "stiffness.effects", "stiffness.effects.HYPOTHESES"),
    ],
)
def test_a_missing_entry_fails_at_import_with_the_name_of_the_list(
    missing, package, named, root, tmp_path
):
    done = run(follow(tmp_path, root, without=missing), f"import {package}")
    assert done.returncode == 1
    assert f"{named} has no {{'belt_ratio'}}" in done.stderr


def test_the_recipe_names_every_file_that_is_changed(root):
    recipe = (root / "bench" / "README.md").read_text("utf-8")
    _, recipe = recipe.split("## How to add an effect")
    for file in ENTRIES:
        link = file if file.startswith("stiffness") else file.removeprefix("bench/")
        assert f"({'../' if file.startswith('stiffness') else ''}{link})" in recipe
