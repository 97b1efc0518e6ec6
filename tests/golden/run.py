"""All cases, run with the tree in the current folder; their results go to a folder.

`python run.py FOLDER quick|all`. Every step leaves what it wrote to the terminal, its
exit status and its files in the folder of its case. Exit status 1 where a command
failed, or where no case came past a point of points.toml.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from cases import STEPS, chosen
from watched import POINTS

WATCHED = Path(__file__).with_name("watched.py")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
FIXED = dict.fromkeys(THREADS, "1") | {
    "OMP_WAIT_POLICY": "PASSIVE",
    "OPENBLAS_CORETYPE": os.environ.get("OPENBLAS_CORETYPE") or "Haswell",
    "PYTHONHASHSEED": "0",
    "COLUMNS": "100",
}
"""What would change last digits (kernels of OpenBLAS), sets' order, or line breaks."""


def commands(step: str, folder: Path, tree: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the label and the words of a command, for each file that a `*` matches."""
    real = Path(os.environ.get("REAL_RECORDINGS", "")).resolve()
    wild = next((word for word in step.split() if "*" in word), "")
    for file in sorted(folder.glob(wild)) if wild else [Path()]:
        one = step.replace(wild, file.relative_to(folder).as_posix()) if wild else step
        words = one.format(tree=tree, real=real, name=file.name).split()
        yield "_".join(filter(None, (words[0], file.name))), words


def run(words: list[str], label: str, folder: Path, tree: Path) -> bool:
    """Run one command of the tree, keep what it wrote, and return whether it failed."""
    module, *flags = words
    program = [sys.executable, "-m", f"scenarios.{module}"]
    if module == "diagnose":
        program[1:2] = [str(WATCHED), f"{label}.points"]
    done = subprocess.run(
        [*program, *flags],
        cwd=folder,
        env={**os.environ, **FIXED, "PYTHONPATH": str(tree)},
        capture_output=True,
        text=True,
        check=False,
    )
    text = f"{done.stdout}--- errors\n{done.stderr}--- exit {done.returncode}\n"
    text = text.replace(str(tree), "TREE")
    (folder / f"{label}.txt").write_text(text, encoding="utf-8")
    if done.returncode:
        print(f"{folder.name}: {' '.join(words)}\n{done.stderr[-800:]}", flush=True)
    return done.returncode != 0


def main(out: Path, cases: str) -> int:
    """Run all cases and return the exit status."""
    failed, tree = False, Path.cwd()
    for name, steps in chosen(cases).items():
        started, folder = time.perf_counter(), out / name
        folder.mkdir(parents=True)
        for number, step in enumerate(steps, start=1):
            first, *rest = step.split()
            if first in STEPS:
                STEPS[first](folder, *rest)
                continue
            for label, words in commands(step, folder, tree):
                failed |= run(words, f"{number}_{label}", folder, tree)
        seconds = time.perf_counter() - started
        print(f"{out.name}: {name}, {seconds:.0f} s", flush=True)
    lines = (file.read_text("utf-8").splitlines() for file in out.rglob("*.points"))
    met = {line.split()[0] for some in lines for line in some}
    for point in POINTS.keys() - met:
        print(f"{out.name}: no case came past {point}; is points.toml up to date?")
    return int(failed or met != POINTS.keys())


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), sys.argv[2]))
