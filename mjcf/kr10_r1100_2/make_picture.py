"""The picture in the README shows the cell at rest under 10 kg on the rope.

Run: MUJOCO_GL=egl python mjcf/kr10_r1100_2/make_picture.py (writes scene.png beside
this file; on a machine with a screen, leave MUJOCO_GL unset).
"""

from pathlib import Path

import mujoco
from PIL import Image

HERE = Path(__file__).parent
WIDTH, HEIGHT = 1520, 1280  # of the rendering; the file has half of each
AT_REST = 2000  # steps of 2 ms


def main() -> None:
    """Load the rope, wait until nothing moves, and take the picture."""
    model = mujoco.MjModel.from_xml_path(str(HERE / "scene.xml"))
    model.vis.quality.offsamples = 8
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_step(model, data, nstep=AT_REST)
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation, camera.distance = 122.0, -11.0, 2.3
    camera.lookat[:] = 0.52, 0.0, 0.36
    options = mujoco.MjvOption()
    options.flags[mujoco.mjtVisFlag.mjVIS_ACTUATOR] = 0
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(data, camera, options)
        picture = Image.fromarray(renderer.render())
    half = picture.resize((WIDTH // 2, HEIGHT // 2), Image.Resampling.LANCZOS)
    half.save(HERE / "scene.png", optimize=True)


if __name__ == "__main__":
    main()
