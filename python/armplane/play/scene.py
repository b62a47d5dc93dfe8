"""What is drawn: the arm, its ghost, the target, and what the hand can and cannot do."""

import collections

import numpy as np
import trimesh
from viser.transforms import SO3

from .. import wire
from ..rotation import rotation_exp

SHELL, JOINT, HAND, ZETA = (214, 220, 230), (62, 74, 98), (250, 204, 60), (255, 66, 200)
GHOST, ALARM, TRAIL, ELLIPSOID = (255, 160, 72), (255, 60, 60), (150, 190, 255), (90, 200, 190)
# |s| over η_out from which on ζ is drawn.
ZETA_SHOWN = 2.0
TRAIL_POINTS = 60


def quaternion(R):
    return SO3.from_matrix(R).wxyz


class Arm:
    """Links as tubes between joints, joints as cylinders; each hangs on a frame that moves."""

    def __init__(self, scene, name, robot, girth, **look):
        self.robot, self.scene, self.look = robot, scene, look
        self.frames, self.parts = [], []
        rest, widest = robot.frames((robot.lower + robot.upper) / 2), girth * robot.reach
        self._tube(f"{name}/base", np.zeros(3), rest[0, :3, 3], widest, SHELL)
        for i, axis in enumerate(robot.axes()):
            radius, R = widest * (1 - 0.5 * i / robot.dof), rest[i, :3, :3]
            tip = R.T @ (rest[i + 1, :3, 3] - rest[i, :3, 3])
            self.frames.append(scene.add_frame(f"{name}/{i}", show_axes=False))
            self._tube(f"{name}/{i}/link", np.zeros(3), tip, 0.72 * radius, SHELL)
            half = 1.15 * radius * axis
            self._tube(f"{name}/{i}/joint", -half, half, radius, JOINT)

    def _tube(self, name, a, b, radius, colour):
        """From a to b; a link with a ball at its end."""
        length, look = float(np.linalg.norm(b - a)), {"color": colour, **self.look}
        wxyz = quaternion(trimesh.geometry.align_vectors([0, 0, 1], b - a)[:3, :3]) if length > 1e-6 else (1, 0, 0, 0)
        self.parts.append(self.scene.add_cylinder(name, radius, max(length, 1e-6), wxyz=wxyz, position=(a + b) / 2, **look))
        if colour == SHELL:
            self.parts.append(self.scene.add_icosphere(f"{name}/end", radius, position=(0, 0, length / 2), **look))

    def move(self, q):
        """Takes the posture; returns the frames."""
        found = self.robot.frames(q)
        for frame, X in zip(self.frames, found):
            frame.wxyz, frame.position = quaternion(X[:3, :3]), X[:3, 3]
        return found


class Scene:
    """All of it, for one robot."""

    def __init__(self, server, robot, floor, start):
        """`floor`: its height in base axes, m; `start`: the camera is placed for this posture."""
        self.server, self.robot, scene, reach = server, robot, server.scene, robot.reach
        scene.reset()
        # Shadows would cost three pictures a picture, and the software renderer the run's time.
        scene.configure_default_lights(cast_shadow=False)
        x, y, _ = robot.frames(start)[-1, :3, 3]
        self.around = rotation_exp(np.array([0, 0, np.arctan2(y, x)])) * reach
        self.camera = None
        for client in server.get_clients().values():
            self.aim(client)
        grey, light = (42, 48, 60), (64, 72, 90)
        scene.add_grid("/floor", 6 * reach, 6 * reach, cell_size=reach / 10, section_size=reach / 2, position=(0, 0, floor), cell_color=grey, section_color=light)
        if floor < -0.05 * reach:
            scene.add_cylinder("/pedestal", 0.07 * reach, -floor, JOINT, position=(0, 0, floor / 2))
        self.arm, self.ghost = Arm(scene, "/arm", robot, 0.042), None
        self.target = scene.add_transform_controls("/target", scale=0.16 * reach, line_width=3.0, disable_sliders=True, depth_test=False, opacity=0.9)
        self.grip = scene.add_icosphere("/target/grip", 0.048 * reach, HAND)
        self.leash = self._lines("/leash", 1, HAND, 2.0)
        self.trail = self._lines("/trail", TRAIL_POINTS - 1, TRAIL, 2.5)
        self.elbows = collections.deque(maxlen=TRAIL_POINTS)
        self.ellipsoid = scene.add_icosphere("/ellipsoid", 1.0, ELLIPSOID, opacity=0.25)
        self._add_zeta(scene, reach)

    def _lines(self, name, count, colour, width):
        return self.server.scene.add_line_segments(name, np.zeros((count, 2, 3)), colour, thickness=width, thickness_units="screen")

    def _add_zeta(self, scene, reach):
        """Arrows on both sides of the hand, at one of them the ring, at the other the frame."""
        near, far = 0.2 * reach, 0.38 * reach
        self.zeta = scene.add_frame("/zeta", show_axes=False, visible=False)
        arrows = np.array([[[side * near, 0, 0], [side * far, 0, 0]] for side in (1, -1)])
        scene.add_arrows("/zeta/arrows", arrows, ZETA, shaft_radius=0.009 * reach, head_radius=0.025 * reach, head_length=0.06 * reach)
        self.frame = scene.add_frame("/zeta/frame", axes_length=0.13 * reach, axes_radius=0.005 * reach, position=(near, 0, 0))
        ring = trimesh.creation.torus(0.05 * reach, 0.006 * reach)
        ring.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], [1, 0, 0]))
        self.ring = scene.add_mesh_simple("/zeta/ring", ring.vertices, ring.faces, color=ZETA, position=(-0.26 * reach, 0, 0))
        self.label = scene.add_label("/zeta/label", "ζ", position=(far, 0, 0), anchor="bottom-center")

    def aim(self, client):
        """Places a browser's camera: the arm beside the panel, on a phone above it."""
        is_tall = client.camera.aspect < 1
        look_at = self.around @ ([0.33, 0.1, -0.5] if is_tall else [0.63, 0.42, 0.2])
        away = self.around @ np.array([1.25, -1.9, 0.85]) * (1.55 if is_tall else 0.95)
        camera, self.camera = client.camera, [(look_at + away).tolist(), look_at.tolist()]
        camera.position, camera.look_at, camera.fov = look_at + away, look_at, 0.85

    def remove_ghost(self):
        self.server.scene.remove_by_name("/ghost")
        self.ghost = None

    def show_ghost(self, session, is_red):
        """The arm of the other law; red from the moment when a joint has reached a limit."""
        if self.ghost is None:
            self.ghost = Arm(self.server.scene, "/ghost", session.robot, 0.05, opacity=0.3, color=GHOST)
        self.ghost.move(session.q)
        for part in self.ghost.parts if is_red else ():
            part.color = ALARM

    def show(self, seen, goal, is_ours):
        """One picture. `goal`: of the target, `None` where it is the hand's pose; `is_ours`: a
        person drags it, so that it is already there."""
        q = np.array(seen["plant_state"].q[: self.robot.dof])
        frames = self.arm.move(q)
        R, p = frames[-1, :3, :3], frames[-1, :3, 3]
        position, wxyz = (p, quaternion(R)) if goal is None else goal
        if not is_ours:
            self.target.position, self.target.wxyz = position, wxyz
        self.leash.points = np.array([[p, position]])
        self.elbows.append(frames[self.robot.dof // 2, :3, 3])
        points = [self.elbows[0]] * (TRAIL_POINTS - len(self.elbows)) + [*self.elbows]
        self.trail.points = np.stack([points[:-1], points[1:]], axis=1)
        self._show_zeta(seen["servo_state"], seen["singularity"], p)
        J = self.robot.arm.at(q).J[:3]
        squares, axes = np.linalg.eigh(J @ J.T)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        radii = 0.3 * np.sqrt(np.maximum(squares, 0.0)) + 1e-3
        self.ellipsoid.position, self.ellipsoid.wxyz = p, quaternion(axes)
        self.ellipsoid.scale = tuple(radii.tolist())

    def _show_zeta(self, servo, report, p):
        self.zeta.visible = servo.singularity > 0 and servo.nearest < ZETA_SHOWN
        if not self.zeta.visible:
            return
        place = servo.singularity - 1
        one = report.singularities[place]
        self.zeta.position = p
        self.zeta.wxyz = quaternion(np.array(one.R_BS).reshape(3, 3).T)
        self.label.text = f"ζ {name_of(self.robot, place)}, {wire.TYPES.get(one.class_, '')}"
        self.ring.visible, self.frame.visible = bool(one.angular), bool(one.inside)


def name_of(robot, place):
    """A singularity's name."""
    names = robot.singular_names
    return names[place] if place < len(names) else f"s{place + 1}"
