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


class Arm:
    """The links as tubes between the joints, the joints as cylinders; each hangs on a frame that moves."""

    def __init__(self, scene, name, robot, girth, **look):
        self.robot, self.scene, self.look, widest = robot, scene, look, girth * robot.reach
        self.frames, self.parts = [], []
        self._tube(f"{name}/base", np.zeros(3), robot.bodies[0][1], widest, SHELL)
        for i, (_, _, axis, _) in enumerate(robot.bodies):
            radius, tip = widest * (1 - 0.5 * i / robot.dof), (robot.bodies[i + 1] if i + 1 < robot.dof else robot.tip)[1]
            self.frames.append(scene.add_frame(f"{name}/{i}", show_axes=False))
            self._tube(f"{name}/{i}/link", np.zeros(3), tip, 0.72 * radius, SHELL)
            self._tube(f"{name}/{i}/joint", -1.15 * radius * axis, 1.15 * radius * axis, radius, JOINT)

    def _tube(self, name, a, b, radius, colour):
        """From a to b, with a ball at its end."""
        length = float(np.linalg.norm(b - a))
        place = {"wxyz": quaternion(trimesh.geometry.align_vectors([0, 0, 1], b - a)[:3, :3]) if length > 1e-6 else (1, 0, 0, 0), "position": (a + b) / 2}
        look = {"color": colour, **self.look}
        self.parts.append(self.scene.add_cylinder(name, radius, max(length, 1e-6), **place, **look))
        if colour == SHELL:
            self.parts.append(self.scene.add_icosphere(f"{name}/end", radius, position=(0, 0, length / 2), **look))

    def move(self, q):
        """Takes the posture; returns the frames."""
        found = self.robot.frames(q)
        for frame, (R, p) in zip(self.frames, found):
            frame.wxyz, frame.position = quaternion(R), p
        return found


class Scene:
    """All of it, for one robot."""

    def __init__(self, server, robot, floor, start):
        """`floor`: its height in base axes, m; `start`: the posture for which the camera is placed."""
        self.server, self.robot, scene = server, robot, server.scene
        reach = robot.reach
        scene.reset()
        x, y, _ = robot.frames(start)[-1][1]
        self.around = rotation_exp(np.array([0, 0, np.arctan2(y, x)])) * reach
        self.camera = None
        for client in server.get_clients().values():
            self.aim(client)
        grid = {"cell_size": reach / 10, "section_size": reach / 2, "cell_color": (42, 48, 60), "section_color": (64, 72, 90)}
        scene.add_grid("/floor", 6 * reach, 6 * reach, position=(0, 0, floor), shadow_opacity=0.4, **grid)
        if floor < -0.05 * reach:
            scene.add_cylinder("/pedestal", 0.07 * reach, -floor, JOINT, position=(0, 0, floor / 2))
        self.arm, self.ghost = Arm(scene, "/arm", robot, 0.042), None
        self.target = scene.add_transform_controls("/target", scale=0.16 * reach, line_width=3.0, disable_sliders=True, depth_test=False, opacity=0.9)
        self.grip = scene.add_icosphere("/target/grip", 0.048 * reach, HAND, cast_shadow=False)
        self.leash = scene.add_line_segments("/leash", np.zeros((1, 2, 3)), HAND, thickness=2.0, thickness_units="screen")
        self._add_zeta(scene, reach)
        self.ellipsoid = scene.add_icosphere("/ellipsoid", 1.0, ELLIPSOID, opacity=0.25, cast_shadow=False, receive_shadow=False)
        self.trail = scene.add_line_segments("/trail", np.zeros((TRAIL_POINTS - 1, 2, 3)), TRAIL, thickness=2.5, thickness_units="screen")
        self.elbows = collections.deque(maxlen=TRAIL_POINTS)

    def aim(self, client):
        """Places a browser's camera: the arm beside the panel, on a phone above it."""
        is_tall = client.camera.aspect < 1
        look_at = self.around @ ([0.33, 0.1, -0.5] if is_tall else [0.63, 0.42, 0.2])
        away = self.around @ np.array([1.25, -1.9, 0.85]) * (1.55 if is_tall else 0.95)
        client.camera.position, client.camera.look_at, client.camera.fov = look_at + away, look_at, 0.85
        self.camera = [*map(list, (look_at + away, look_at))]

    def _add_zeta(self, scene, reach):
        """Arrows on both sides of the handle; on one of them the ring, on the other the singular frame."""
        near, far = 0.2 * reach, 0.38 * reach
        self.zeta = scene.add_frame("/zeta", show_axes=False, visible=False)
        arrows = np.array([[[side * near, 0, 0], [side * far, 0, 0]] for side in (1, -1)])
        scene.add_arrows("/zeta/arrows", arrows, ZETA, shaft_radius=0.009 * reach, head_radius=0.025 * reach, head_length=0.06 * reach)
        self.frame = scene.add_frame("/zeta/frame", axes_length=0.13 * reach, axes_radius=0.005 * reach, position=(near, 0, 0))
        ring = trimesh.creation.torus(0.05 * reach, 0.006 * reach)
        ring.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], [1, 0, 0])).apply_translation([-0.26 * reach, 0, 0])
        self.ring = scene.add_mesh_simple("/zeta/ring", ring.vertices, ring.faces, color=ZETA, cast_shadow=False)
        self.label = scene.add_label("/zeta/label", "ζ", position=(far, 0, 0), anchor="bottom-center")

    def remove_ghost(self):
        self.server.scene.remove_by_name("/ghost")
        self.ghost = None

    def show_ghost(self, session, is_red):
        """The arm of the other law; red from the moment when a joint has reached a limit."""
        if self.ghost is None:
            self.ghost, self.is_red = Arm(self.server.scene, "/ghost", session.robot, 0.05, opacity=0.3, color=GHOST, cast_shadow=False), False
        self.ghost.move(session.q)
        if is_red and not self.is_red:
            self.is_red = True
            for part in self.ghost.parts:
                part.color = ALARM

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
        self.elbows.append(frames[self.robot.dof // 2][1])
        points = np.array([self.elbows[0]] * (TRAIL_POINTS - len(self.elbows)) + list(self.elbows))
        self.trail.points = np.stack([points[:-1], points[1:]], axis=1)
        self._show_zeta(servo, report, p)
        J = self.robot.arm.at(q).J[:3]
        squares, axes = np.linalg.eigh(J @ J.T)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        radii = 0.3 * np.sqrt(np.maximum(squares, 0.0)) + 1e-3
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
        if self.frame.visible != bool(one.inside):
            self.frame.visible = bool(one.inside)


def name_of(robot, place):
    """A singularity's name."""
    return robot.singular_names[place] if place < len(robot.singular_names) else f"s{place + 1}"
