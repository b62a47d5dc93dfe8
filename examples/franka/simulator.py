"""The simulator `franka-sim` without a download: the arm of its own URDF, in MuJoCo, behind Franka's control interface on port 1337.

    python3 -m venv .venv && .venv/bin/pip install franka-sim==1.1.7
    .venv/bin/python simulator.py --no-gripper --enforce-motion-limits --enforce-comm-constraints

Options are those of `run-franka-sim-server`. It would load the arm of MuJoCo Menagerie over the network; this arm has no meshes, so no collisions, and
the rotor inertias of that one. `simulator.py --check` only says whether the simulator is installed.
"""
import os
import signal
import sys
import tempfile
from xml.etree import ElementTree

ROTOR_INERTIA = [0.195, 0.195, 0.195, 0.195, 0.074, 0.074, 0.074]  # kg m2 at the joint; MuJoCo Menagerie, franka_fr3


def arm() -> str:
    """The arm of the wheel's URDF as MJCF: links without shapes, joints with rotor inertia."""
    import franka_sim
    import mujoco

    path = os.path.join(os.path.dirname(franka_sim.__file__), "models", "fr3.urdf")
    robot = ElementTree.parse(path).getroot()
    for link in robot.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    # Every link stays a body of its own, with the inertia that the URDF states.
    ElementTree.SubElement(ElementTree.SubElement(robot, "mujoco"), "compiler", fusestatic="false", discardvisual="true", balanceinertia="false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, encoding="unicode"))
    for joint, inertia in zip(spec.joints, ROTOR_INERTIA, strict=True):
        joint.armature = inertia
    spec.compile()
    return spec.to_xml()


def main() -> None:
    try:
        from franka_sim import run_server
    except ImportError as error:
        sys.exit(f"simulator.py: franka-sim is not installed for {sys.executable} ({error}): pip install franka-sim==1.1.7")
    if sys.argv[1:] == ["--check"]:
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the folder is removed then too
    with tempfile.TemporaryDirectory(prefix="franka-sim-") as folder:
        path = os.path.join(folder, "fr3.xml")
        with open(path, "w") as file:
            file.write(arm())
        os.environ["FR3_MJCF"] = path
        run_server.main()


if __name__ == "__main__":
    main()
