import ast
import json
import re
import subprocess
import sys
from itertools import chain

import numpy as np
import pytest
from beartype import beartype
from checked_shapes import EVERY, FIRST, sparingly
from jaxtyping import Float, TypeCheckError
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from source import (
    PROJECT,
    ROOT,
    committed_texts,
    dependencies,
    docstring,
    effect_files,
    imports,
    module_name,
    names_called,
    nodes,
    python_files,
    risky_calls,
    scenario_files,
    text,
    within,
)

from bench.shared.format.faults import Place
from stiffness.robot.arm import Arm
from stiffness.robot.wrench import to_flange

SIDES = ("bench", "stiffness", "scenarios")
ENGINES = ("diagnosis", "calibration", "dual_encoder")
"""Of `stiffness`, one for each kind of recording; none imports another."""
SOURCES = python_files(*SIDES)
CLAIMS = python_files("stiffness")
SHARED = ("bench.shared",)
"""All that claims may know of the bench."""
BEYOND = ("mujoco", "bench", "scenarios")
"""Where truth lives, and what puts both sides together; `SHARED` aside, no claim sees
anything of it, not even through what is shared."""
DETOURS = ("importlib", "runpy", "pkgutil", "ctypes", "subprocess", "sys", "builtins")
"""Ways to reach a module without importing it by name."""
LONGEST = 600
"""Lines above which a file holds more than one idea, or its header says why not."""
RUNS_CODE = ("pickle", "cPickle", "dill", "cloudpickle", "shelve", "marshal")
IMPORTED_AS = {"pin": "pinocchio", "rerun-sdk": "rerun"}


# --- Two sides -----------------------------------------------------------------------


@pytest.mark.parametrize("file", CLAIMS)
def test_methods_never_import_the_truth(file):
    """A method that sees an effect, the rig or MuJoCo could cheat."""
    package = module_name(file) if file.endswith("__init__.py") else None
    names = imports(text(file), package or module_name(file).rpartition(".")[0])
    known = [name for name in names if within(name, (*BEYOND, *DETOURS))]
    assert [name for name in known if not within(name, SHARED)] == []


@pytest.mark.parametrize(
    "file", [*python_files("bench", "stiffness"), *python_files("scenarios/pipelines")]
)
def test_only_commands_and_reports_write_to_the_terminal(file):
    """A line from within would show where a caller wants quiet, and again each call."""
    assert [name for name in imports(text(file), "") if within(name, ("rich",))] == []
    assert "print" not in names_called(text(file))


def test_bars_are_made_in_one_place():
    """Where it is seen to that they are quiet in a pipe, and vanish."""
    makers = {"rich.progress.Progress", "rich.progress.track"}
    made = [f for f in SOURCES if makers & set(imports(text(f)))]
    assert made == ["scenarios/report/command_line.py"]


@pytest.mark.slow
def test_importing_every_method_leaves_mujoco_out_of_the_process():
    """Nor does a noun bring the truth along."""
    modules = modules_after(f"import {', '.join(map(module_name, CLAIMS))}")
    assert "stiffness" in modules
    seen = [name for name in modules if within(name, BEYOND) and name != "bench"]
    assert [name for name in seen if not within(name, SHARED)] == []


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("import mujoco.batch as b", "mujoco.batch"),
        ("from bench import rig", "bench.rig"),
        ("from bench.effects.creep import Creep", "bench.effects.creep.Creep"),
        ("def f():\n    from mujoco import MjModel", "mujoco.MjModel"),
        ("from ..bench import rig", "bench.rig"),
        ("from .score import Score", "stiffness.methods.score.Score"),
    ],
)
def test_every_way_to_import_is_seen(source, name):
    package = "stiffness.methods" if "score" in source else "stiffness"
    assert list(imports(source, package)) == [name]


@pytest.mark.parametrize("file", SOURCES)
def test_library_imports_are_declared(file):
    """What is imported stands in pyproject.toml, with its reason."""
    asked = chain(PROJECT["dependencies"], *PROJECT["optional-dependencies"].values())
    names = [Requirement(line).name for line in asked]
    known = {IMPORTED_AS.get(name, name) for name in names} | set(SIDES)
    used = {name.partition(".")[0] for name in imports(text(file), "bench.inside")}
    assert used - known - sys.stdlib_module_names == set()


# --- Files ---------------------------------------------------------------------------


@pytest.mark.parametrize("file", SOURCES)
def test_first_line_of_a_file_is_one_sentence(file):
    """It says what is true in the world, on the first line and whole."""
    first = docstring(file).partition("\n")[0]
    opening = text(file).partition("\n")[0]
    assert opening.startswith('"""'), f"{file} opens with {opening!r}"
    assert first.endswith((".", "?")), f"{file} opens with {first!r}"
    assert not re.search(r"[.?!] [A-Z]", first), f"two sentences: {first!r}"


@pytest.mark.parametrize("file", SOURCES)
def test_file_is_one_idea_long(file):
    assert text(file).count("\n") <= LONGEST


@pytest.mark.parametrize("file", scenario_files())
def test_scenario_says_how_to_run_it_how_long_it_takes_and_what_to_expect(file):
    manual = docstring(file)
    missing = [
        row
        for row in ("Run:", "Takes:", "Expect:")
        if not re.search(rf"^{row}\s+\S", manual, re.MULTILINE)
    ]
    assert missing == []
    assert f"python -m {module_name(file)}" in manual


@pytest.mark.parametrize("file", effect_files())
def test_effect_states_equation_source_validity_and_what_it_ignores(file):
    rows = re.findall(r"^(\w+) {2,}\S", docstring(file), re.MULTILINE)
    assert rows == ["Equation", "Source", "Valid", "Ignores"]


# --- Rooms ---------------------------------------------------------------------------

COMMANDS = [f for f in python_files("scenarios") if f.count("/") == 1 and "__" not in f]
LONGEST_COMMAND = 120
"""Lines of a command: flags, a call, what is printed."""
MOST_FILES = 222
"""Files beside those of effects and examples; never to rise."""
TINY = 60
"""Lines under which a file with one importer belongs into that importer."""
DOORS = ("bench", "stiffness", "scenarios.pipelines")
"""Packages whose own file is for notebooks: it opens onto everything, and nothing of
ours goes through it, so that it is no arrow."""
MOST_LOADED = 110
"""Modules beside those of effects that the command `diagnose` brings along, as they
are; to fall, never to rise."""
DIAGNOSIS_FILES, DIAGNOSIS_LEVELS, DIAGNOSIS_EDGES = 20, 9, 60
"""As they are; to fall, never to rise."""
HEAVY = {"mujoco", "pinocchio", "torch", "rerun", "matplotlib", "scipy"}


def graph() -> dict[str, set[str]]:
    """Return which of our modules each of them imports."""
    return dependencies(tuple(SOURCES))


def modules_after(program: str) -> list[str]:
    """Return the modules that a fresh process has loaded after a line of Python."""
    line = f"{program}; import json, sys; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", line],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("file", COMMANDS)
def test_command_is_thin_and_imported_by_nobody(file):
    """What two commands share lies in pipelines, report or studies."""
    assert text(file).count("\n") <= LONGEST_COMMAND
    assert [name for name, used in graph().items() if module_name(file) in used] == []


@pytest.mark.slow
def test_the_manual_of_a_command_is_shown_without_what_the_command_needs():
    """The flags of `record` are settings of instruments, which bring their library."""
    names = [m for f in COMMANDS if (m := module_name(f)) != "scenarios.record"]
    assert HEAVY & set(modules_after(f"import {', '.join(names)}")) == set()


@pytest.mark.parametrize(
    ("package", "never"),
    [
        ("bench.shared", ("bench", "stiffness", "scenarios", "mujoco", "pinocchio")),
        ("bench", ("stiffness", "scenarios")),
        ("scenarios.pipelines", ("scenarios.report", "scenarios.studies")),
        ("scenarios.report", ("scenarios.studies",)),
        (
            "stiffness.regression",
            tuple(f"stiffness.{p}" for p in ("diagnosis", "robot")),
        ),
        ("stiffness.setup", tuple(f"stiffness.{p}" for p in (*ENGINES, "effects"))),
        *(
            (f"stiffness.{one}", tuple(f"stiffness.{p}" for p in ENGINES if p != one))
            for one in ENGINES
        ),
    ],
)
def test_arrows_between_rooms_point_one_way(package, never):
    wrong = [
        f"{file}: {name}"
        for file in SOURCES
        if within(module_name(file), (package,)) and module_name(file) not in DOORS
        for name in imports(text(file), module_name(file).rpartition(".")[0])
        if within(name, never) and not within(name, (package, *SHARED))
    ]
    assert wrong == []


@pytest.mark.parametrize("door", DOORS)
def test_nothing_of_ours_goes_through_a_door(door):
    examples = {module_name(f) for f in python_files("scenarios/examples")}
    assert {n for n, used in graph().items() if door in used} <= examples


@pytest.mark.slow
def test_doors_open_without_a_library():
    """Nor with numpy: what a notebook imports first is there at once."""
    loaded = modules_after(f"import {', '.join(DOORS)}")
    assert (HEAVY | {"numpy"}) & set(loaded) == set()


@pytest.mark.slow
def test_a_diagnosis_brings_few_modules_along():
    """What it does not need is imported where it is: calibration, second encoders."""
    loaded = modules_after("import scenarios.report.route")
    effects = ("bench.effects", "stiffness.effects")
    ours = [m for m in loaded if within(m, SIDES) and not within(m, effects)]
    others = ("stiffness.calibration", "stiffness.dual_encoder", "scenarios.studies")
    assert [m for m in ours if within(m, others)] == []
    assert len(ours) <= MOST_LOADED


def test_there_are_few_files():
    others = ("bench/effects/", "stiffness/effects/", "scenarios/examples/")
    assert len([f for f in SOURCES if not f.startswith(others)]) <= MOST_FILES


def test_no_file_is_a_piece_of_its_only_importer():
    importers = {
        name: [n for n, used in graph().items() if name in used and n not in DOORS]
        for name in graph()
    }
    pieces = [
        file
        for file in SOURCES
        if text(file).count("\n") < TINY
        and len(importers[module_name(file)]) == 1
        and not file.endswith("__init__.py")
        and "/effects/" not in file
    ]
    assert pieces == []


def test_the_diagnosis_is_read_in_few_steps():
    """Files, levels of imports, and imports among them."""
    inside = {n for n in graph() if within(n, ("stiffness.diagnosis",))}
    edges = {n: graph()[n] & inside for n in inside}
    level: dict[str, int] = {}
    while len(level) < len(edges):
        ready = {n for n in edges if n not in level and edges[n] <= level.keys()}
        assert ready, "a circle of imports"
        level |= {n: 1 + max((level[m] for m in edges[n]), default=0) for n in ready}
    assert len(inside) <= DIAGNOSIS_FILES
    assert max(level.values()) <= DIAGNOSIS_LEVELS
    assert sum(map(len, edges.values())) <= DIAGNOSIS_EDGES


# --- Functions and records -----------------------------------------------------------


def test_shapes_are_checked_at_first_and_now_and_then():
    def shaped(x: Float[np.ndarray, "3"]) -> None: ...

    function, refused = sparingly(shaped, beartype), []
    for call in range(1, 1 + FIRST + 2 * EVERY):
        try:
            function(np.zeros(4))
        except TypeCheckError:
            refused.append(call)
    later = [k for k in range(FIRST + 1, 1 + FIRST + 2 * EVERY) if k % EVERY == 0]
    assert refused == [*range(1, 1 + FIRST), *later]


@pytest.mark.parametrize("checked", [to_flange, Arm.for_recording, Place.__init__])
def test_functions_of_ours_are_checked(checked):
    """Methods and what makes a record too."""
    assert checked.__code__.co_filename.endswith("checked_shapes.py")


UNSAID = {"tuple", "list", "Sequence", "Any", "object"}
"""Annotations that do not say what a row of things is made of."""
MOST_FIELDS = 12
"""Fields of a dataclass, but for a format on disk and the flags of a command."""
FORMATS = {
    "bench/shared/recording.py: Recording",
    "bench/patch.py: Patch",
    "scenarios/blind_trials.py: Settings",
    "scenarios/record.py: Settings",
    "scenarios/studies/arm_trials.py: ArmTrial",
    "scenarios/studies/blind_trials/score.py: TrialScore",
}
LARGE = {
    "bench/proof/proof.py: Proof": 14,
    "scenarios/pipelines/judgement.py: Judgement": 13,
    "scenarios/studies/blind_trials/strata.py: Stratum": 14,
    "stiffness/calibration/model.py: Readings": 16,
    "stiffness/calibration/result.py: Calibrated": 17,
    "stiffness/diagnosis/nominal_fit.py: Prepared": 13,
    "stiffness/diagnosis/result.py: Diagnosis": 20,
    "stiffness/diagnosis/within_visit.py: WithinVisitModel": 13,
    "stiffness/experiment/static_state.py: StaticState": 20,
}
"""Others as they are; to be divided, never to grow and never to be joined by more."""


def unpacked(source: str) -> list[str]:
    """Return where a function takes a parameter apart whose parts no type names."""
    found = []
    for node in nodes(source):
        if isinstance(node, ast.FunctionDef):
            unsaid = {
                a.arg
                for a in ast.walk(node.args)
                if isinstance(a, ast.arg)
                and (a.annotation is None or ast.unparse(a.annotation) in UNSAID)
            }
            found += [
                f"{node.name}, line {step.lineno}"
                for step in ast.walk(node)
                if isinstance(step, ast.Assign)
                and isinstance(step.targets[0], ast.Tuple)
                and isinstance(step.value, ast.Name)
                and step.value.id in unsaid
            ]
    return found


def test_parameters_taken_apart_without_a_type_are_seen():
    assert unpacked("def f(at):\n    a, b = at") == ["f, line 2"]
    assert unpacked("def f(at: tuple):\n    a, b = at") == ["f, line 2"]
    assert unpacked("def f(at: tuple[int, int]):\n    a, b = at") == []


@pytest.mark.parametrize("file", SOURCES)
def test_no_function_takes_apart_a_tuple_of_which_no_type_says_what_it_holds(file):
    """Such a tuple is a dataclass that nobody named."""
    assert unpacked(text(file)) == []


def test_records_are_small():
    counts = {
        f"{file}: {node.name}": sum(isinstance(b, ast.AnnAssign) for b in node.body)
        for file in SOURCES
        for node in nodes(text(file))
        if isinstance(node, ast.ClassDef)
        and any("dataclass" in ast.unparse(d) for d in node.decorator_list)
    }
    large = {c: n for c, n in counts.items() if n > MOST_FIELDS and c not in FORMATS}
    assert {c: n for c, n in large.items() if n > LARGE.get(c, MOST_FIELDS)} == {}
    assert LARGE.keys() - large.keys() == set()


# --- Safety --------------------------------------------------------------------------


@pytest.mark.parametrize("file", SOURCES)
def test_no_code_runs_out_of_a_file(file):
    """Recordings and models come from strangers: they are data, never code."""
    source = text(file)
    assert [name for name in imports(source, "x") if within(name, RUNS_CODE)] == []
    assert list(risky_calls(source)) == []


@pytest.mark.parametrize(
    "source",
    [
        "eval(x)",
        "np.load(f, allow_pickle=True)",
        "joblib.load(f)",
        "torch.load(f)",
        "subprocess.run(c, shell=True)",
    ],
)
def test_calls_that_run_code_are_seen(source):
    assert len(list(risky_calls(source))) == 1


def test_calls_that_only_look_alike_pass():
    assert list(risky_calls("network.eval(); re.compile(p); np.load(f)")) == []


# --- Anyone's machine ----------------------------------------------------------------


@pytest.fixture(scope="module")
def texts():
    """All texts of the project, by path."""
    found = committed_texts()
    if not found:
        pytest.skip("not a git checkout")
    return found


@pytest.mark.parametrize(
    ("foreign", "sample", "excepted"),
    [
        pytest.param(
            r"(?<![\w.])/(?:work|tmp|home|root|Users)/",
            "open('/{}/x')".format("tmp"),
            (),
            id="paths of one machine",
        ),
        pytest.param(
            r"py[p]i\.org|pytho[n]hosted|pyto[r]ch\.org/whl|np[m]js|anacon[d]a\.org"
            r"|--(?:extra-)?inde[x]-url|fin[d]-links",
            "{}.org/simple".format("pypi"),
            (),
            id="package registries",
        ),
        pytest.param(
            r"\.\./shar[e]d", "../{}/x".format("shared"), (".ci/run",), id="data beside"
        ),
    ],
)
def test_texts_hold_no(foreign, sample, excepted, texts):
    assert re.search(foreign, sample)
    found = [name for name, content in texts.items() if re.search(foreign, content)]
    assert [name for name in found if name not in excepted] == []


# --- Dependencies --------------------------------------------------------------------


def test_every_dependency_has_a_reason():
    """One comment above each says why the project leans on it."""
    lines = [line.strip() for line in text("pyproject.toml").splitlines()]
    asked = chain(PROJECT["dependencies"], *PROJECT["optional-dependencies"].values())
    above = {name: lines[lines.index(f'"{name}",') - 1] for name in asked}
    assert [
        name for name, line in above.items() if not re.match(r"# \w.{9,}", line)
    ] == []


def test_constraints_pin_what_make_installs_on_any_machine():
    """One plain version each: no address, no path, no build tag."""
    pins = {}
    for line in text("constraints.txt").splitlines():
        if not line.startswith("#"):
            name, version = line.split("==")
            assert re.fullmatch(r"[0-9][0-9a-z.]*", version), line
            pins[canonicalize_name(name)] = version
    extras = PROJECT["optional-dependencies"]
    for line in PROJECT["dependencies"] + extras["test"] + extras["lint"]:
        asked = Requirement(line)
        assert asked.specifier.contains(pins[canonicalize_name(asked.name)]), line


def test_python_files_parse_on_the_oldest_python():
    """The floor in pyproject.toml is the floor of the source."""
    major, minor = PROJECT["requires-python"].removeprefix(">=").split(".")
    for file in SOURCES:
        ast.parse(text(file), feature_version=(int(major), int(minor)))
