"""The measuring cell that a person opens by hand: the arm, a rope and what pulls it.

Run: python mjcf/kr10_r1100_2/make_scene.py (writes scene.xml beside this file), then
python -m mujoco.viewer --mjcf mjcf/kr10_r1100_2/scene.xml. The arm is kr10_r1100_2.xml
to the last digit; only the springs' rest angles are moved, to the posture `HOME`.
With --picture, it also renders scene.png, the picture in the README (MUJOCO_GL=egl on a
machine without a screen).
Places and props are chosen, for looks, except where a line says otherwise.
"""

import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

HERE = Path(__file__).parent
WIDTH, HEIGHT = 1520, 1280  # of the rendering; the file has half of each
AT_REST = 2000  # steps of 2 ms
HOME = np.radians([0.0, -90.0, 90.0, 0.0, 0.0, 90.0])  # the hook stands beside A6

SETTING = """
<mujoco>
  <option integrator="discrete" timestep="0.002"/>
  <statistic center="0.5 0 0.4" extent="1.5"/>
  <visual>
    <headlight ambient="0.32 0.32 0.32" diffuse="0.42 0.42 0.42"
               specular="0.1 0.1 0.1"/>
    <global azimuth="140" elevation="-14" offwidth="1600" offheight="1400"/>
    <quality shadowsize="4096"/>
    <rgba haze="0.86 0.88 0.90 1"/>
  </visual>
</mujoco>
"""

ASSETS = """
<asset>
  <texture name="sky" type="skybox" builtin="gradient" rgb1="0.93 0.94 0.95"
           rgb2="0.66 0.71 0.77" width="256" height="1536"/>
  <texture name="floor" type="2d" builtin="checker" rgb1="0.84 0.85 0.86"
           rgb2="0.81 0.82 0.83" mark="edge" markrgb="0.74 0.75 0.76"
           width="300" height="300"/>
  <material name="floor" texture="floor" texrepeat="2.5 2.5" texuniform="true"
            reflectance="0.06"/>
  <material name="steel" rgba="0.30 0.32 0.35 1" specular="0.4" shininess="0.5"/>
  <material name="profile" rgba="0.70 0.72 0.74 1" specular="0.6" shininess="0.6"/>
  <material name="weight" rgba="0.20 0.22 0.26 1" specular="0.5" shininess="0.5"/>
</asset>
"""

PROPS = """
<worldbody>
  <light pos="0.9 -1.6 2.6" dir="-0.25 0.5 -0.9" diffuse="0.55 0.55 0.55"/>
  <light pos="-1.2 1.8 2.2" dir="0.5 -0.6 -0.7" diffuse="0.18 0.18 0.20"
         castshadow="false"/>
  <geom name="floor" type="plane" size="2.5 2.5 0.05" pos="0.4 0 -0.45" material="floor"
        contype="0" conaffinity="0"/>
  <geom class="prop" type="box" size="0.17 0.17 0.0125" pos="0 0 -0.0125"
        material="steel"/>
  <geom class="prop" type="box" size="0.10 0.10 0.2075" pos="0 0 -0.2325"
        material="steel"/>
  <geom class="prop" type="box" size="0.22 0.22 0.010" pos="0 0 -0.44"
        material="steel"/>
  <body name="pulley" pos="1.18 {hook_y} 1.12">
    <geom name="pulley" class="prop" type="sphere" size="0.030" rgba="0 0 0 0"/>
    <geom class="prop" type="cylinder" size="0.029 0.004" euler="1.5708 0 0"
          material="silver"/>
    <geom class="prop" type="cylinder" size="0.036 0.002" pos="0 0.006 0"
          euler="1.5708 0 0" material="profile"/>
    <geom class="prop" type="cylinder" size="0.036 0.002" pos="0 -0.006 0"
          euler="1.5708 0 0" material="profile"/>
    <geom class="prop" type="cylinder" size="0.006 0.05" pos="0 0.055 0"
          euler="1.5708 0 0" material="steel"/>
    <geom class="prop" type="box" size="0.020 0.020 0.79" pos="0 0.11 -0.76"
          material="profile"/>
    <geom class="prop" type="box" size="0.15 0.15 0.010" pos="0 0.11 -1.56"
          material="steel"/>
    <site name="pulley_side" pos="0.0318 0 0.0318" size="0.003" group="4"/>
    <site name="eye" pos="0.030 0 -0.55" size="0.004" rgba="0.2 0.2 0.2 1"/>
    <geom class="prop" type="cylinder" size="0.005 0.09" pos="0.030 0 -0.64"
          material="silver"/>
    <geom class="prop" type="cylinder" size="0.055 0.022" pos="0.030 0 -0.70"
          material="weight"/>
    <geom class="prop" type="cylinder" size="0.055 0.022" pos="0.030 0 -0.653"
          material="weight"/>
  </body>
</worldbody>
"""

# Sensor: disc of 82 x 25.4 mm and 0.3 kg, the size of an ATI Axia80 (not checked
# against its data sheet). Inertias: solid discs.
TOOL = """
<body>
  <body name="sensor_near_side">
    <inertial mass="0.3" pos="0 0 0.0127" diaginertia="0.000142 0.000142 0.000252"/>
    <geom class="prop" type="cylinder" size="0.041 0.0125" pos="0 0 0.0129"
          material="black"/>
    <geom class="prop" type="cylinder" size="0.0412 0.002" pos="0 0 0.0127"
          material="silver"/>
  </body>
  <body name="sensor_far_side" pos="0 0 0.0254">
    <inertial mass="0.2" pos="0 0 0.006" diaginertia="8.6e-05 8.6e-05 0.000168"/>
    <geom class="prop" type="cylinder" size="0.041 0.005" pos="0 0 0.005"
          material="profile"/>
    <geom class="prop" type="box" size="0.033 0.011 0.004" pos="0.033 0 0.014"
          material="profile"/>
    <geom class="prop" type="capsule" size="0.0035" fromto="0.05 0 0.014 0.05 0 0.034"
          material="silver"/>
    <geom class="prop" type="sphere" size="0.006" pos="0.05 0 0.04" material="silver"/>
    <site name="sensor" size="0.003" group="4"/>
    <site name="hook" pos="0.05 0 0.04" size="0.003" group="4"/>
  </body>
</body>
"""

MACHINERY = """
<mujoco>
  <tendon>
    <spatial name="rope" width="0.0022" rgba="0.93 0.90 0.80 1">
      <site site="hook"/>
      <geom geom="pulley" sidesite="pulley_side"/>
      <site site="eye"/>
    </spatial>
  </tendon>
  <actuator>
    <motor name="tension" tendon="rope" gear="-1" ctrlrange="0 150"/>
  </actuator>
  <sensor>
    <force name="force" site="sensor"/>
    <torque name="torque" site="sensor"/>
    <framepos name="flange" objtype="xbody" objname="flange"/>
  </sensor>
  <keyframe>
    <key name="home" qpos="{home}" ctrl="98.1"/>
  </keyframe>
</mujoco>
"""


def scene() -> ElementTree.Element:
    """Return the arm's model with the cell put around it and onto its tool."""
    arm = ElementTree.parse(HERE / "kr10_r1100_2.xml").getroot()
    arm.set("model", "kr10_r1100_2_cell")
    for place, element in enumerate(ElementTree.fromstring(SETTING)):
        arm.insert(1 + place, element)
    prop = {"mass": "0", "contype": "0", "conaffinity": "0", "group": "1"}
    defaults = _find(arm, "default")
    ElementTree.SubElement(
        ElementTree.SubElement(defaults, "default", {"class": "prop"}), "geom", prop
    )
    _find(arm, "asset").extend(ElementTree.fromstring(ASSETS))
    # A6 = 90 deg turns the flange's x axis, along which the hook stands, to base -y.
    _find(arm, "worldbody").extend(ElementTree.fromstring(PROPS.format(hook_y=-0.05)))
    _find(arm, ".//body[@name='tool']").extend(ElementTree.fromstring(TOOL))
    for number, angle in enumerate(HOME, start=1):
        _find(arm, f".//joint[@name='a{number}']").set("springref", repr(float(angle)))
    home = " ".join(repr(float(angle)) for angle in HOME)
    arm.extend(ElementTree.fromstring(MACHINERY.format(home=home)))
    arm.insert(0, ElementTree.Comment(" Written by make_scene.py; change that. "))
    return arm


def _find(element: ElementTree.Element, path: str) -> ElementTree.Element:
    found = element.find(path)
    if found is None:
        raise LookupError(f"kr10_r1100_2.xml has no {path!r}.")
    return found


def render_picture() -> None:
    """Write scene.png: the cell at rest under 10 kg on the rope."""
    import mujoco  # noqa: PLC0415
    from PIL import Image  # noqa: PLC0415

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
    tree = ElementTree.ElementTree(scene())
    ElementTree.indent(tree)
    tree.write(HERE / "scene.xml")
    if "--picture" in sys.argv[1:]:
        render_picture()
