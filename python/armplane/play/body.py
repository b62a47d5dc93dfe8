"""The body of an arm: the primitives and meshes of its file, each on the link that carries it."""

import os
import pathlib

import numpy as np
import trimesh

from .robot import numbers, origin

SHELL, METAL, DARK = (228, 226, 218), (168, 174, 182), (52, 57, 66)
# A mesh of more triangles is drawn coarser: its corners on a grid of so many steps.
MOST, STEPS = 5_000, 60
SIZES = ("size", "radius", "length")
UNREADABLE = (OSError, ValueError, LookupError, TypeError, AttributeError, ImportError)


class Body:
    """`parts`: (link, its pose there, kind, sizes, colour), -1 for the base; `lacking`: why a mesh
    cannot be read. Simpler shapes stand in for it: those for collisions, or a tube."""

    def __init__(self, robot):
        """`robot`: of `play.robot`."""
        self.folder, self.parts, self.lacking = robot.folder, [], None
        self.materials = {one.get("name"): one for one in robot.tree.findall("material")}
        places = [(*robot.links[link.get("name")], link) for link in robot.tree.findall("link")]
        for number, tip in enumerate(robot.tips, -1):
            own, found = [place for place in places if place[0] == number], []
            for kind in ("visual", "collision"):
                try:
                    found = found or [part for place in own for part in self._parts(*place, kind)]
                except UNREADABLE as error:
                    self.lacking = self.lacking or str(error)
            self.parts += found or _tube(number, tip, robot.reach)

    def _parts(self, number, X, link, kind):
        for shape in link.findall(kind):
            form, material = shape.find("geometry")[0], shape.find("material")
            colour = DARK if number < 0 else METAL if number % 2 else SHELL
            if material is not None:
                named = self.materials.get(material.get("name"), material)
                paints = [*material.findall("color"), *named.findall("color")]
                colour = tuple(numbers(paints[0], "rgba")[:3].tolist()) if paints else colour
            sizes = [float(x) for key in SIZES for x in form.get(key, "").split()]
            sizes = self._triangles(form) if form.tag == "mesh" else sizes
            yield number, X @ origin(shape), form.tag, sizes, colour

    def _triangles(self, form):
        mesh = trimesh.load(self._find(form.get("filename")), force="mesh")
        mesh.apply_scale(numbers(form, "scale", "1 1 1"))
        if len(mesh.faces) > MOST:
            grain = mesh.extents.max() / STEPS
            mesh.vertices = np.round(mesh.vertices / grain) * grain
            mesh.merge_vertices()
            mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
        return mesh.vertices, mesh.faces

    def _find(self, file):
        """A path from the robot's folder, or a URL: of a package above it, or where ROS has it."""
        if not self.folder:
            return file
        scheme, _, path = file.rpartition("://")
        homes = [home := pathlib.Path(self.folder)]
        if scheme == "package":
            ros = ":".join(os.environ.get(one, "") for one in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"))
            homes += [*home.parents, *(pathlib.Path(one, end) for end in ("", "share") for one in ros.split(":") if one)]
        return str(next((one / path for one in homes if (one / path).is_file()), path))


def _tube(number, tip, reach):
    """For a link without shapes, to its end."""
    length = float(np.linalg.norm(tip))
    if length < 1e-6:
        return []
    X = trimesh.geometry.align_vectors([0, 0, 1], tip)
    X[:3, 3] = tip / 2
    return [(number, X, "capsule", [0.03 * reach, length], SHELL)]
