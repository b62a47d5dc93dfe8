"""The arm of a job: its description and its URDF, as the run's processes have them."""

import math
import tomllib
import xml.etree.ElementTree as ElementTree


class Joint:
    """A moving joint: limits in rad (m for a sliding one), N·m, rad/s; `armature` in kg·m²."""

    def __init__(self, element, properties):
        limit, dynamics = element.find("limit"), element.find("dynamics")
        of = lambda element, name, default: float(element.get(name, default)) if element is not None else default
        self.name = element.get("name")
        self.kind = element.get("type")
        unlimited = self.kind == "continuous"
        self.lower = properties.get("lower", -math.inf if unlimited else of(limit, "lower", 0.0))
        self.upper = properties.get("upper", math.inf if unlimited else of(limit, "upper", 0.0))
        self.effort = properties.get("effort", of(limit, "effort", math.inf))
        self.velocity = properties.get("velocity", of(limit, "velocity", math.inf))
        self.armature = properties.get("armature", 0.0)
        self.viscous_friction = properties.get("viscous_friction", of(dynamics, "damping", 0.0))
        self.coulomb_friction = properties.get("coulomb_friction", of(dynamics, "friction", 0.0))


class Robot:
    """`joints` of the chain from the base to the end-effector `frame`, and the elements of the URDF (`links` by name, `chain` in order)."""

    def __init__(self, job):
        text, scenario = job["robot"], job["scenario"]
        self.description = tomllib.loads(text["description"])
        urdf = ElementTree.fromstring(text["urdf"])
        self.links = {link.get("name"): link for link in urdf.findall("link")}
        joints = urdf.findall("joint")
        children = {joint.find("child").get("link") for joint in joints}
        root = next(name for name in self.links if name not in children)
        self.base = self.description.get("base_frame", root)
        if self.base != root:
            raise ValueError(f"the base of this arm is not the root of its URDF ({self.base}, {root}): not supported here")
        self.children = {}
        for joint in joints:
            self.children.setdefault(joint.find("parent").get("link"), []).append(joint)
        table = self.description.get("joints", {})
        if any("locked" in properties for properties in table.values()):
            raise ValueError("this arm has locked joints: not supported here")
        self.moving = {}
        self._walk(self.base, table)
        self.joints = list(self.moving.values())
        self.frame = scenario.get("frame") or self.description.get("default_frame") or self._last(self.base)
        self.gravity = self.description.get("gravity", [0.0, 0.0, -9.81])

    def _walk(self, link, table):
        for joint in self.children.get(link, []):
            if joint.get("type") in ("revolute", "continuous", "prismatic"):
                self.moving[joint.get("name")] = Joint(joint, table.get(joint.get("name"), {}))
            elif joint.get("type") != "fixed":
                raise ValueError(f"joint {joint.get('name')} is {joint.get('type')}: not supported here")
            self._walk(joint.find("child").get("link"), table)

    def _last(self, link):
        return self._last(self.children[link][0].find("child").get("link")) if link in self.children else link

    def start(self, scenario):
        """The posture in which a scenario starts; rad (m of joints that slide)."""
        start = scenario["start"]
        if start.get("q") is not None:
            return list(start["q"])
        if start.get("q_deg") is not None:
            return [math.radians(q) for q in start["q_deg"]]
        return list(self.description["postures"][start["posture"]])
