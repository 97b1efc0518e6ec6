"""Holds the list of names that the field has a better word for."""

import ast
import re
from collections.abc import Iterator
from pathlib import PurePosixPath

import pytest
from source import parsed, python_files, text

SOURCES = python_files("bench", "stiffness", "scenarios")
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)

KEPT = {
    *("where", "equivalents", "rivals", "located", "floor", "posture", "screw"),
    *("held_out_gain", "Recording", "Visit", "Arm", "Chain", "Patch", "Proof"),
    *("Candidate", "Library"),
}
"""Short and unambiguous, or a key of the format on disk."""

GLOSSARY = {
    # Robotics
    "Situation": "StaticState",
    "Standing": "ArmState",
    "Stance": "CalibrationState",
    "standing_under_load": "static_equilibrium",
    "Turn": "JointRotation",
    "Shift": "MarkerDisplacement",
    "Reading": "EncoderError",
    "Signature": "EffectJacobian",
    "levers": "point_jacobian",
    "Part": "JacobianBlock",
    "spot": "marker_position",
    "place": "site, or marker_position",
    "Sight": "TrackerObservations",
    "first_frames": "initial_tracker_frame",
    "seated": "fit_tracker_frame",
    "quickly_seated": "fit_tracker_frame_once",
    "Frames": "TrackerFit",
    "arrival": "pose_repeatability",
    "knobs": "parameters",
    "followed_load": "load_response",
    "redrawn": "corrected_geometry",
    "drawn": "geometry",
    "creeps": "velocity_lag",
    "late": "delay",
    "Late": "DelayFit",
    "waves": "harmonics",
    "tables": "error_tables",
    "two_encoders": "dual_encoder",
    "World": "ReplaySimulation",
    "Seen": "SimulatedReadings",
    "Assumed": "NominalState",
    "laid_out": "replay_setup",
    "turns": "rotations",
    "silent": "nominal_fit, or nuisance",
    "Gauge": "ComparisonMode",
    "feigned": "induced",
    "feigns": "mimics",
    "strangers": "out_of_library_effects",
    "outsiders": "out_of_library_effects",
    # Regression and statistics
    "Evidence": "NormalEquations",
    "Data": "SufficientStatistics",
    "Columns": "DesignMatrix",
    "beside": "hstack",
    "Within": "WithinVisitModel",
    "Between": "BetweenVisitModel, or EncoderComparison",
    "Information": "FisherInformation",
    "Contrasts": "WithinVisitContrasts",
    "unknowns": "nuisance_parameters",
    "unknown_columns": "nuisance_jacobian",
    "smooth_error": "volumetric_error_process",
    "cross_of": "cross_gram",
    "beside_many": "given_many",
    "by_pose": "per_pose_scores",
    "ByPose": "PerPoseScores",
    "freedom": "degrees_of_freedom",
    "gains": "chi_square_gains",
    "sample_of": "subsample_poses",
    "channels": "noise_subspace",
    "tare": "force_sensor_tare_noise",
    "steady": "average_encoders",
    "steadied": "average_encoders",
    "shapes_kept": "rigid_body_noise",
    "misfit": "rms_summary",
    "other_readings": "setup_alternatives",
    "other_sights": "setup_alternatives",
    "other_columns": "setup_alternatives",
    "other_loads": "setup_alternatives",
    "odd_units": "detect_unit_errors",
    "mixed_markers": "detect_swapped_markers",
    "mistakes_of_set_up": "setup_errors",
    "slips": "setup_errors",
    "gone": "rejected",
    "taken_back": "rejected",
    "whole_fit": "final_fit",
    "growing": "drift_term",
    "pruning": "backward_elimination",
    "neighbours": "spatial_correlation",
    "regions": "spatial_folds",
    "Roots": "Whitening",
    "white_turn": "whitening_transform",
    "without": "projection_coefficients",
    "left_of": "schur_complement",
    "projected": "project_out",
    "absorbed": "nuisance_coefficients",
    "taken": "nuisance_removed",
    "pull": "weighted_residual",
    "pulls": "scores",
    "raw_pulls": "raw_scores",
    "cleaned": "centred_scores",
    "moved": "displacement",
    "less": "subtract",
    "left": "residual",
    "leftover": "residual_test",
    "what_is_left": "residual_test",
    "own_leftover": "is_same_law_residual",
    "is_own": "is_same_law_residual",
    "alone": "drop_one_gains",
    "without_set": "residual_after",
    "Uneven": "HomogeneityTest",
    "unevenness": "homogeneity_tests",
    "Member": "ModelTerm",
    "SetFit": "ModelFit",
    "Scored": "EvaluatedModel",
    "close_look": "evaluate_model",
    "vain": "insignificant",
    "earns": "improves_prediction",
    "is_clear": "is_significant",
    "Ranked": "RankedModels",
    "ranked": "rank_models",
    "sets": "models",
    "every": "candidates",
    "White": "WhitenedCandidates",
    "white_candidates": "whiten_candidates",
    "_front": "shortlist",
    "_reach": "evidence_margin",
    "extended": "forward_step",
    "exchanged": "exchange_step",
    "settled": "fitted_jointly",
    "case_of": "build_problem",
    "Case": "SelectionProblem",
    "Found": "DetectionTest",
    "Tested": "MaxTResult",
    "flips": "sign_flip_test",
    "families": "combine_tests",
    "calm": "scatter_limit",
    "wild": "dispersion_limit",
    "scatters": "is_overdispersed",
    "loudest": "most_significant",
    "strongest": "most_significant",
    "alike": "equivalents, or confounded_with",
    "unnamed": "out_of_library_residual",
    "weigh": "visibility",
    "weight": "visibility",
    "contradicted": "is_contradicted",
    "contradicted_by_what_is_left": "rejected_by_residual",
    "differs": "is_inhomogeneous",
    "doubtful": "downweighted",
    "sure": "credible",
    "MOST": "a name with its noun: MAX_EFFECTS",
    "LARGEST": "a name with its noun: MAX_EXHAUSTIVE_SIZE",
    "DWARFS": "RESIDUAL_SHARE_LIMIT",
    "DIFFERS": "INHOMOGENEITY_LIMIT",
    "ALARM": "SIGNIFICANCE",
    # Trials and reports
    "stood": "observed_states",
    "sized": "calibrate_magnitude",
    "sizes": "magnitudes",
    "shown": "report_tables",
    "concealed": "effect_site_draw",
    "accused": "method_under_test",
    "seals": "commitments",
    "make": "generate_trial",
    "told": "summary",
    "telling": "terminal_summary",
    "story": "narrative",
    "Finding": "Result",
    "remains": "residual_summary",
    "remarks": "warnings",
    "carried_out": "run",
    "refusals": "rejected_terms",
    "compared": "heldout_comparison",
    "epoch": "clock_offset",
    "rests": "standstills",
    "wanted": "required_columns",
    "outcome": "result",
    # Homonyms
    "Trial": "BlindTrial, ProofCheck or SelectionStep",
    "Named": "SelectedModel, or PatchEffect",
}
"""What a name of the left is called instead; an underscore in front changes nothing."""

ONLY_FUNCTIONS = {"score": "evaluate"}
"""Bad names of functions alone: the field's word for a vector."""

EXCEPTIONS = {
    # Keys of files, and flags of commands
    "manifest.Frames": "the table [frames] of a recording's manifest",
    "Extras.rests": "the table [rests] of a mapping",
    "Visibility.left": "a key of a blind trial's truth file",
    "Question.without": "a key of the questions of a blind trial",
    "Encoders.arrival": "a parameter of an instrument, and a source of random numbers",
    "Markers.slips": "a parameter of an instrument: marks that slip",
    # In the repr of a cell, after which its results are kept
    "Sweep.every": "a setting of a study: every how many postures",
    "Transfer.every": "a setting of a study",
    "Effort.every": "a setting of a study",
    "Imitation.every": "a setting of a study",
    "FineTuning.pull": "a setting of a study: towards the weights before",
    "Cnn.channels": "the field's word for a convolution's",
    # Another meaning, and the field's word for it
    "Listeners.every": "steps between two reports of a training",
    "FineTuned.epoch": "an epoch of a training",
    "Settle.slips": "tendons that slip",
    "ReplaySimulation.weight": "a weight in N",
    "Residuals.weight": "a statistical weight",
    "FisherInformation.weight": "a statistical weight",
    "Checked.weight": "a statistical weight",
    "WithinVisitModel.weight": "a statistical weight",
    "GaussianProcess.weight": "weights of a kernel's columns",
    "Alignment.weight": "a weight in a loss",
    "TrackerObservations.weight": "a statistical weight",
}
"""Names that stay although they are on the left, each with its reason."""


def names(file: str) -> Iterator[tuple[str, str, bool]]:
    """Yield owner, name and whether it is a function's, of all that a file defines."""
    path = PurePosixPath(file)
    module = path.parent.name if path.name == "__init__.py" else path.stem
    yield "", module, False
    for node in parsed(text(file)).body:
        yield from _names(node, module)


def _names(node: ast.stmt, owner: str) -> Iterator[tuple[str, str, bool]]:
    if isinstance(node, FUNCTIONS):
        yield owner, node.name, True
    elif isinstance(node, ast.ClassDef):
        yield owner, node.name, False
        for inner in node.body:
            yield from _names(inner, node.name)
            yield from ((node.name, name, False) for name in _of_self(inner))
    elif isinstance(node, (ast.Assign, ast.AnnAssign)):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        for target in targets:
            for name in ast.walk(target):
                if isinstance(name, ast.Name):
                    yield owner, name.id, False
    elif isinstance(node, (ast.If, ast.Try)):
        for inner in (*node.body, *node.orelse):
            yield from _names(inner, owner)


def _of_self(node: ast.stmt) -> Iterator[str]:
    """Yield the attributes that a method gives its object."""
    for inner in ast.walk(node):
        if isinstance(inner, ast.Attribute) and isinstance(inner.ctx, ast.Store):
            if isinstance(inner.value, ast.Name) and inner.value.id == "self":
                yield inner.attr


def better(name: str, is_function: bool) -> str:
    """Return what the field calls a name; empty: the name is as good as any."""
    bare = name.lstrip("_")
    if bare in KEPT:
        return ""
    listed = GLOSSARY | ONLY_FUNCTIONS if is_function else GLOSSARY
    return listed.get(name) or listed.get(bare, "")


@pytest.mark.parametrize("file", SOURCES)
def test_names_are_those_of_the_field(file):
    """No module, class, function, field or constant has a name of the left."""
    found = [
        f"{owner}.{name}: {word}"
        for owner, name, is_function in names(file)
        if f"{owner}.{name}" not in EXCEPTIONS and (word := better(name, is_function))
    ]
    assert found == []


PARAMETERS = {
    **{"gauge": "mode", "stance": "state", "sight": "observed"},
    **{"world": "simulation"},
}
"""Names of parameters whose types have been called otherwise."""


@pytest.mark.parametrize("file", SOURCES)
def test_parameters_are_called_as_their_types_are(file):
    """Of all functions, those without a name too."""
    every = (n for n in ast.walk(parsed(file)) if isinstance(n, ast.arg))
    found = [f"{n.arg}: {PARAMETERS[n.arg]}" for n in every if n.arg in PARAMETERS]
    assert found == []


def test_every_exception_is_still_there():
    """What is gone needs no reason."""
    there = {f"{owner}.{name}" for file in SOURCES for owner, name, _ in names(file)}
    assert set(EXCEPTIONS) - there == set()


def test_kept_names_are_not_replaced():
    assert KEPT & set(GLOSSARY) == set()


WORDS = (
    *("feign", "silently", "stranger", "leftover", "speak", "accused", "what is left"),
    *(r"wild(?! cluster bootstrap)", r"calm\b", r"vain\b", r"a look\b"),
    "knows nothing of",
)
"""Words of prose for which the field has others."""


@pytest.mark.parametrize("word", WORDS)
def test_prose_uses_the_words_of_the_field(word):
    pattern = re.compile(rf"\b{word}", re.IGNORECASE)
    lines = ((file, line) for file in SOURCES for line in text(file).splitlines())
    assert [(file, line) for file, line in lines if pattern.search(line)] == []
