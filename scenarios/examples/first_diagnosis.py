"""A first diagnosis from Python, cell by cell: simulate, diagnose, ask, prove, draw.

Open it in an editor that runs `# %%` cells, or run it whole from the project's folder:
`python scenarios/examples/first_diagnosis.py`, half a minute.
"""

# %% An arm: any MJCF or URDF
from tempfile import mkdtemp

import bench
import stiffness
from scenarios import pipelines

model = bench.load_model("mjcf/kr10_r1100_2/kr10_r1100_2.xml")

# %% A recording of it: here a simulated one, in which an effect is concealed.
# Your own is read by: seen = bench.read("my-recording", model)
hidden = bench.effects.Hysteresis("a2", width_rad=3e-4)
seen = bench.simulate(model, bench.plan(poses=18), effects=[hidden], seed=4)

# %% Where do recording and model differ, and why? Proved in the simulator.
result = pipelines.diagnose(seen, model)
print(result)

# %% One name, with its intervals
width = result["hysteresis", "a2"].parameters["width_rad"]
print(f"{width.estimate:.3g} rad ({width.low:.3g} to {width.high:.3g})")

# %% Why was another effect not named?
print(result.why_not("creep", "a2"))

# %% The law at the axis, measured and simulated: a figure of matplotlib
figure = result.figure("a2")

# %% What the command would write: report, patch, model, playback
page = result.report(mkdtemp())
print(page)

# %% The claim alone, without a simulator: names, intervals, decisions
arm = stiffness.Arm.from_model(model)
found = stiffness.diagnose(seen, arm)
print(found)

# %% Does the patch hold on another day? Half of its poses judge.
assert result.patch is not None
later = bench.simulate(model, bench.plan(poses=12), effects=[hidden], seed=5)
judged = sorted(set(later.posture_id.tolist()))[::2]
proof = bench.prove(result.patch, later, model, judged, thorough=False)
assert proof.markers is not None
print(f"{1e6 * proof.markers.before:.1f} µm -> {1e6 * proof.markers.after:.1f} µm")
