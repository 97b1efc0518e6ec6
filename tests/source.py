"""Files of the project, their imports and calls, for the architecture tests."""

import ast
import re
import subprocess
import tomllib
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
parsed = cache(ast.parse)
"""The tree of a source; none is changed."""
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


@cache
def nodes(source: str) -> tuple[ast.AST, ...]:
    """Return every node of a source's tree."""
    return tuple(ast.walk(parsed(source)))


@cache
def calls(source: str) -> tuple[tuple[ast.Call, str], ...]:
    """Return every call of a source, with the name of what is called."""
    found = (node for node in nodes(source) if isinstance(node, ast.Call))
    return tuple((node, ast.unparse(node.func)) for node in found)


def python_files(*folders: str) -> list[str]:
    """Return the Python files of some folders as paths from the root, sorted."""
    found = (path for folder in folders for path in (ROOT / folder).rglob("*.py"))
    return sorted(path.relative_to(ROOT).as_posix() for path in found)


def scenario_files() -> list[str]:
    """Return the files of `scenarios` that can be run."""
    files = python_files("scenarios")
    return [f for f in files if re.search(r"^if __name__ ==", text(f), re.MULTILINE)]


def effect_files() -> list[str]:
    """Return the files of `bench` that hold an effect which can be built."""
    return [
        file
        for file in python_files("bench")
        if re.search(r"^class \w+\(\w*Effect\):", text(file), re.MULTILINE)
        and "abstractmethod" not in text(file)
    ]


@cache
def text(file: str) -> str:
    """Return a file's text."""
    return (ROOT / file).read_text("utf-8")


def docstring(file: str) -> str:
    """Return a module's docstring, empty without one."""
    return ast.get_docstring(parsed(text(file))) or ""


def module_name(file: str) -> str:
    """Return the name under which a file is imported."""
    return file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


@cache
def imports(source: str, package: str = "") -> tuple[str, ...]:
    """Return the full name of everything that a source imports, in functions too.

    Args:
        source: Python text.
        package: The package it lies in, from which relative imports are counted.
    """
    found: list[str] = []
    for node in nodes(source):
        if isinstance(node, ast.Import):
            found += (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: 1 - node.level or None]
            start = ".".join(parents) if node.level else ""
            origin = ".".join(part for part in (start, node.module) if part)
            found += (f"{origin}.{alias.name}" for alias in node.names)
    return tuple(found)


def within(name: str, parents: tuple[str, ...]) -> bool:
    """Return whether a dotted name is one of some modules, or lies inside one."""
    return any(name == parent or name.startswith(f"{parent}.") for parent in parents)


def names_called(source: str) -> set[str]:
    """Return the names of all that a source calls."""
    return {name for _, name in calls(source)}


RISKY_CALLS = {
    *("eval", "exec", "compile", "__import__", "os.system", "os.popen"),
    *("joblib.load", "joblib.dump", "torch.load", "torch.save"),
}
RISKY_SETTINGS = {("allow_pickle", "True"), ("shell", "True")}


@cache
def dependencies(files: tuple[str, ...]) -> dict[str, set[str]]:
    """Return which of some files' modules each of them imports."""
    modules = {module_name(file): file for file in files}
    found = {}
    for module, file in modules.items():
        package = module if file.endswith("__init__.py") else module.rpartition(".")[0]
        found[module] = {
            within_one
            for name in imports(text(file), package)
            if (within_one := _module_of(name, modules)) not in ("", module)
        }
    return found


def _module_of(name: str, modules: Collection[str]) -> str:
    """Return the module that a full name is or lies in; empty: none of these."""
    while name and name not in modules:
        name = name.rpartition(".")[0]
    return name


def risky_calls(source: str) -> Iterator[str]:
    """Yield every call that runs a text as code, or goes through pickle."""
    for node, called in calls(source):
        if called in RISKY_CALLS:
            yield f"{called}, line {node.lineno}"
        for keyword in node.keywords:
            if (keyword.arg, ast.unparse(keyword.value)) in RISKY_SETTINGS:
                yield f"{called}(… {ast.unparse(keyword)}), line {node.lineno}"


def committed_texts() -> dict[str, str]:
    """Return path and text of everything that is, or is about to be, committed.

    Binary files are left out; embedded pictures are cut from the texts.
    """
    listing = ["ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    answer = subprocess.run(
        ["git", "-c", "safe.directory=*", *listing],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    texts = {}
    for name in filter(None, answer.stdout.split("\0")):
        path = ROOT / name
        content = path.read_bytes() if path.is_file() else b"\0"
        if b"\0" not in content:
            plain = content.decode("utf-8", errors="replace")
            texts[name] = re.sub(r"base64,[A-Za-z0-9+/=\s]+", "", plain)
    return texts
