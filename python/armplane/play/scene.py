"""What is drawn: the arm, its ghost, the target, and what the hand can and cannot do."""

import collections

import numpy as np
import trimesh
from viser.transforms import SO3

from .. import wire
from ..rotation import rotation_exp

SHELL, JOINT, HAND = (214, 220, 230), (62, 74, 98), (250, 204, 60)
ZETA, GHOST, ALARM, TRAIL, ELLIPSOID = (255, 66, 200), (255, 160, 72), (255, 60, 60), (150, 190, 255), (90, 200, 190)
# |s| over η_out from which on ζ is drawn.
ZETA_SHOWN = 2.0
TRAIL_POINTS = 60


def quaternion(R):
    return SO3.from_matrix(R).wxyz


def _between(a, b, radius):
    """A tube from a to b with round ends."""
    length = float(np.linalg.norm(b - a))
    if length < 1e-6:
        return trimesh.creation.icosphere(subdivisions=2, radius=radius).apply_translation(a)
    tube = trimesh.creation.capsule(height=length, radius=radius, count=[12, 24])
    tube.apply_translation([0, 0, -tube.bounds[:, 2].mean()])
    return tube.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], (b - a) / length)).apply_translation((a + b) / 2)


def _housing(axis, radius):
    """The motor of a joint, around its axis."""
    motor = trimesh.creation.cylinder(radius=radius, height=2.3 * radius, sections=32)
    return motor.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], axis))


class Arm:
    """The links as tubes between the joints, the joints as cylinders; each hangs on a frame that moves."""

    def __init__(self, scene, name, robot, ghost=False):
        self.robot, self.scene, self.name = robot, scene, name
        n, widest = robot.dof, 0.042 * robot.reach
        tips = [R_p[1] for R_p in robot.bodies[1:]] + [robot.tip[1]]
        self.frames, self.meshes = [], []
        look = {"opacity": 0.22, "color": GHOST, "cast_shadow": False} if ghost else {}
        base = _between(np.zeros(3), robot.bodies[0][1], 1.15 * widest)
        self._mesh(f"{name}/base", [base], look or {"color": SHELL})
        for i, (body, tip) in enumerate(zip(robot.bodies, tips)):
            radius = widest * (1 - 0.5 * i / n)
            self.frames.append(scene.add_frame(f"{name}/{i}", show_axes=False))
            self._mesh(f"{name}/{i}/link", [_between(np.zeros(3), tip, 0.72 * radius)], look or {"color": SHELL})
            self._mesh(f"{name}/{i}/joint", [_housing(body[2], radius)], look or {"color": JOINT})
        self.frames.append(scene.add_frame(f"{name}/hand", axes_length=0.09 * robot.reach, axes_radius=0.004 * robot.reach, show_axes=not ghost))

    def _mesh(self, name, parts, look):
        mesh = trimesh.util.concatenate(parts)
        self.meshes.append(self.scene.add_mesh_simple(name, mesh.vertices, mesh.faces, **look))

    def move(self, q):
        """Takes the posture; returns the frames."""
        found = self.robot.frames(q)
        for frame, (R, p) in zip(self.frames, found):
            frame.wxyz, frame.position = quaternion(R), p
        return found

    def colour(self, colour):
        for mesh in self.meshes:
            mesh.color = colour

    def remove(self):
        self.scene.remove_by_name(self.name)


class Scene:
    """All of it, for one robot."""

    def __init__(self, server, robot, floor, start):
        """`floor`: its height in base axes, m; `start`: the posture for which the camera is placed."""
        self.server, self.robot, scene = server, robot, server.scene
        reach = robot.reach
        scene.reset()
        # The panel covers the right: the arm stands left of the middle.
        x, y, _ = robot.frames(start)[-1][1]
        around = rotation_exp(np.array([0, 0, np.arctan2(y, x)])) * reach
        look_at, away = around @ [0.42, 0.25, 0.12], around @ [1.25, -1.9, 0.85]
        server.initial_camera.position, server.initial_camera.look_at, server.initial_camera.fov = look_at + away, look_at, 0.85
        for client in server.get_clients().values():
            client.camera.position, client.camera.look_at, client.camera.fov = look_at + away, look_at, 0.85
        grid = {"cell_size": reach / 10, "section_size": reach / 2, "cell_color": (42, 48, 60), "section_color": (64, 72, 90)}
        scene.add_grid("/floor", 6 * reach, 6 * reach, position=(0, 0, floor), shadow_opacity=0.4, **grid)
        if floor < -0.05 * reach:
            scene.add_cylinder("/pedestal", 0.07 * reach, -floor, JOINT, position=(0, 0, floor / 2))
        self.arm, self.ghost = Arm(scene, "/arm", robot), None
        self.target = scene.add_transform_controls("/target", scale=0.16 * reach, line_width=3.0, disable_sliders=True, depth_test=False, opacity=0.9)
        self.grip = scene.add_icosphere("/target/grip", 0.048 * reach, HAND, cast_shadow=False)
        self.leash = scene.add_line_segments("/leash", np.zeros((1, 2, 3)), HAND, thickness=2.0, thickness_units="screen")
        self._add_zeta(scene, reach)
        self.ellipsoid = scene.add_icosphere("/ellipsoid", 1.0, ELLIPSOID, opacity=0.13, cast_shadow=False, receive_shadow=False)
        self.trail = scene.add_line_segments("/trail", np.zeros((TRAIL_POINTS - 1, 2, 3)), TRAIL, thickness=2.5, thickness_units="screen")
        self.elbow, self.elbows = robot.dof // 2, collections.deque(maxlen=TRAIL_POINTS)

    def _add_zeta(self, scene, reach):
        length = 0.3 * reach
        self.zeta = scene.add_frame("/zeta", axes_length=0.14 * reach, axes_radius=0.003 * reach, visible=False)
        arrows = np.array([[[0, 0, 0], [length, 0, 0]], [[0, 0, 0], [-length, 0, 0]]])
        scene.add_arrows("/zeta/arrows", arrows, ZETA, shaft_radius=0.007 * reach, head_radius=0.02 * reach, head_length=0.05 * reach)
        ring = trimesh.creation.torus(0.09 * reach, 0.006 * reach)
        ring.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], [1, 0, 0]))
        self.ring = scene.add_mesh_simple("/zeta/ring", ring.vertices, ring.faces, color=ZETA, cast_shadow=False)
        self.label = scene.add_label("/zeta/label", "ζ", position=(0.6 * length, 0, 0), anchor="bottom-center")

    def set_ghost(self, robot):
        """Draws a ghost, or none."""
        if self.ghost:
            self.ghost.remove()
        self.ghost = robot and Arm(self.server.scene, "/ghost", robot, ghost=True)

    def show(self, seen, goal, is_ours):
        """One picture. The target follows the hand where it is not a person's."""
        servo, report = seen["servo_state"], seen["singularity"]
        q = np.array(seen["plant_state"].q[: self.robot.dof])
        frames = self.arm.move(q)
        R, p = frames[-1]
        position, wxyz = (p, quaternion(R)) if goal is None else goal
        if not is_ours:
            self.target.position, self.target.wxyz = position, wxyz
        self.leash.points = np.array([[p, position]])
        self.elbows.append(frames[self.elbow][1])
        points = np.array([self.elbows[0]] * (TRAIL_POINTS - len(self.elbows)) + list(self.elbows))
        self.trail.points = np.stack([points[:-1], points[1:]], axis=1)
        self._show_zeta(servo, report, p)
        J = self.robot.arm.at(q).J[:3]
        squares, axes = np.linalg.eigh(J @ J.T)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        radii = 0.22 * np.sqrt(np.maximum(squares, 0.0)) + 1e-3
        self.ellipsoid.position, self.ellipsoid.wxyz, self.ellipsoid.scale = p, quaternion(axes), tuple(map(float, radii))

    def _show_zeta(self, servo, report, p):
        visible = servo.singularity > 0 and servo.nearest < ZETA_SHOWN
        if visible != self.zeta.visible:
            self.zeta.visible = visible
        if not visible:
            return
        one = report.singularities[servo.singularity - 1]
        self.zeta.position, self.zeta.wxyz = p, quaternion(np.array(one.R_BS).reshape(3, 3).T)
        text = f"ζ {name_of(self.robot, servo.singularity - 1)}, {wire.TYPES.get(one.class_, '')}"
        if text != self.label.text:
            self.label.text, self.ring.visible = text, bool(one.angular)
        if self.zeta.show_axes != (one.inside != 0):
            self.zeta.show_axes = one.inside != 0


def name_of(robot, place):
    """A singularity's name."""
    return robot.singular_names[place] if place < len(robot.singular_names) else f"s{place + 1}"
