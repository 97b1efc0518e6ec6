"""Does the tree give the results of an older commit, to the last digit?

Checks the older commit out into a second work tree, runs the same recordings and
commands with both trees side by side, each on one core, and compares what they wrote.
For changes that leave results alone: files that move, names, merges. Numbers depend on
the processor, so results are not committed; those that differ stay in a folder.

Run:    make golden BASE=HEAD~1        CASES=all for every case
Takes:  1 min on two cores, 6 recordings; 10 min for every case
Expect: 0 differences, exit status 0; otherwise the first of each file, and 1
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import mkdtemp
from typing import Literal

import tyro
from compare import compare

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]


def main(base: str, cases: Literal["quick", "all"] = "quick") -> int:
    """Run both trees, compare their results and return the exit status.

    Args:
        base: The older commit.
        cases: quick: a few recordings, for each commit; all: for each larger step.
    """
    folder = Path(mkdtemp(prefix="golden-"))
    trees = {"old": folder / "tree", "new": ROOT}
    git = ["git", "-C", str(ROOT), "worktree"]
    add = [*git, "add", "--quiet", "--detach", str(trees["old"]), base]
    if subprocess.run(add, check=False).returncode:
        return 2  # git has said why
    try:
        program = [sys.executable, str(HERE / "run.py")]
        begun = [
            subprocess.Popen([*program, str(folder / name), cases], cwd=tree)
            for name, tree in trees.items()
        ]
        failed = any([run.wait() for run in begun])
    finally:
        subprocess.run([*git, "remove", "--force", str(trees["old"])], check=True)
    if compare(folder / "old", folder / "new") or failed:
        print(f"Old and new results are in {folder}.")
        return 1
    shutil.rmtree(folder)
    return 0


if __name__ == "__main__":
    manual = re.sub(r"\n(?=Takes|Expect)", "\n\n", __doc__ or "")
    sys.exit(tyro.cli(main, description=manual, prog="python tests/golden"))
