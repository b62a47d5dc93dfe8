"""What is drawn: the arm, its ghost, the target, and what the hand can and cannot do."""

import collections

import numpy as np
import trimesh
from numpy.linalg import norm
from viser.transforms import SO3

from .. import wire

HAND, ZETA = (250, 204, 60), (255, 66, 200)
GHOST, ALARM, TRAIL, ELLIPSOID = (255, 160, 72), (255, 60, 60), (150, 190, 255), (90, 200, 190)
# |s| over η_out from which on ζ is drawn.
ZETA_SHOWN = 2
TRAIL_POINTS = 60
# The part of the picture beside the panel, on a phone above it, in halves of its width and height
# from the middle: ends on the left and below, on the right and above. Hand and ball stay in it.
BESIDE, ABOVE = np.array([[-0.85, -0.8], [0.2, 0.8]]), np.array([[-0.7, 0.1], [0.7, 0.8]])
# The share of its way that a camera goes in a picture.
CALM = 0.08
# A mesh of more triangles is drawn coarser: its corners on a grid of so many steps.
MOST, STEPS = 5_000, 60


def quaternion(R):
    return SO3.from_matrix(R).wxyz


def _triangles(corners):
    """Corners and faces of a mesh; one of more than MOST triangles is drawn coarser."""
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(len(corners) // 3).reshape(-1, 3))
    if len(mesh.faces) > MOST:
        grain = mesh.extents.max() / STEPS
        mesh.vertices = np.round(mesh.vertices / grain) * grain
        mesh.merge_vertices()
        mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
    return mesh.vertices, mesh.faces


class Arm:
    """The pieces of each link hang on a frame that moves."""

    def __init__(self, scene, name, robot, **look):
        self.robot, self.parts = robot, []
        self.frames = [scene.add_frame(f"{name}/{i}", show_axes=False) for i in range(robot.dof)]
        for k, one in enumerate(robot.solids["pieces"]):
            own = {key: tuple(one[key]) for key in ("color", "position", "wxyz")}
            self._draw(scene, f"{name}/{one['joint']}/{k}", one["form"], np.array(one["sizes"]), {**own, **look})

    def _draw(self, scene, name, form, sizes, look):
        if form == "box":
            part = scene.add_box(name, dimensions=sizes, **look)
        elif form == "mesh":
            part = scene.add_mesh_simple(name, *_triangles(sizes), flat_shading=True, **look)
        else:
            radius, length = sizes.tolist()
            part = scene.add_cylinder(name, radius, length, **look)
            # One cap for a ball.
            for end in {-length / 2, length / 2} if form == "capsule" else ():
                cap = look | {"position": (0, 0, end), "wxyz": (1, 0, 0, 0)}
                self.parts.append(scene.add_icosphere(f"{name}/{end}", radius, **cap))
        self.parts.append(part)

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
        self.around = SO3.from_z_radians(np.arctan2(y, x)).as_matrix() * reach
        # Where each browser's camera has been sent, and from there to what it looks at, m.
        self.sent, self.gaze = {}, {}
        for client in server.get_clients().values():
            self.aim(client)
        grey, light = (42, 48, 60), (64, 72, 90)
        scene.add_grid("/floor", 6 * reach, 6 * reach, cell_size=reach / 10, section_size=reach / 2, position=(0, 0, floor), cell_color=grey, section_color=light)
        self.arm, self.ghost = Arm(scene, "/arm", robot), None
        self.target = scene.add_transform_controls("/target", scale=0.16 * reach, line_width=3.0, disable_sliders=True, depth_test=False, opacity=0.9)
        self.grip = scene.add_icosphere("/target/grip", 0.048 * reach, HAND)
        self.hint = scene.add_label("/hint", "drag me", anchor="bottom-center")
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
        camera = client.camera
        self.take(client.client_id, look_at + away, -away)
        self.sent[client.client_id].appendleft(camera.position)
        camera.position, camera.look_at, camera.fov = look_at + away, look_at, 0.85

    def take(self, client, position, gaze):
        """Begins to follow with a camera that is there."""
        self.sent[client], self.gaze[client] = collections.deque([position], 100), gaze

    def is_sent(self, client, position):
        """Whether a camera is where it has been sent, and nobody has moved it."""
        ways = np.array(self.sent.get(client, [position])) - position
        return norm(ways, axis=1).min() < 0.01 * self.robot.reach

    def camera(self, client):
        """Where it is and what it looks at, as soon as the browser says that it is there."""
        place, gaze = self.sent[client.client_id][-1], self.gaze[client.client_id]
        known, view = client.camera, [place, place + gaze]
        is_there = np.allclose([known.position, known.look_at], view, atol=1e-3)
        return np.array(view).tolist() if is_there else None

    def follow(self, client):
        """Moves a camera, without turning it, as far as hand and ball have left their part."""
        camera, sent, gaze = client.camera, self.sent[client.client_id], self.gaze[client.client_id]
        low, high = ABOVE if camera.aspect < 1 else BESIDE
        ahead = gaze / norm(gaze)
        right = np.cross(ahead, [0, 0, 1]) / max(np.hypot(*ahead[:2]), 1e-9)
        R = np.stack([right, np.cross(right, ahead), ahead], axis=1)
        half = np.tan(camera.fov / 2) * np.array([camera.aspect, 1])
        local = (np.array([self.hand, self.target.position]) - sent[-1]) @ R
        depth = np.maximum(local[:, 2:], 0.3 * self.robot.reach)
        seen = local[:, :2] / depth / half
        below, above = np.minimum(seen.min(axis=0) - low, 0), np.maximum(seen.max(axis=0) - high, 0)
        wider = (np.ptp(seen, axis=0) / (high - low)).max()
        way = depth.mean() * np.append((below + above) * half, min(1 - wider, 0))
        if norm(way) > 0.005 * self.robot.reach:
            sent.append(sent[-1] + CALM * R @ way)
            # Both, for the browser's last word on its camera may be older than what it was sent.
            camera.position, camera.look_at = sent[-1], sent[-1] + gaze

    def remove_ghost(self):
        self.server.scene.remove_by_name("/ghost")
        self.ghost = None

    def show_ghost(self, session, is_red):
        """The arm of the other law; red from the moment when a joint has reached a limit."""
        if self.ghost is None:
            # Larger, so that it does not flicker where it coincides with the arm.
            self.ghost = Arm(self.server.scene, "/ghost", session.robot, opacity=0.3, color=GHOST, scale=1.04)
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
        self.hand = p
        if is_ours:
            self.hint.visible = False
        else:
            self.target.position, self.target.wxyz = position, wxyz
        self.hint.position = position + np.array([0, 0, 0.07 * self.robot.reach])
        self.leash.points = np.array([[p, position]])
        self.elbows.append(frames[self.robot.dof // 2, :3, 3])
        points = [self.elbows[0]] * (TRAIL_POINTS - len(self.elbows)) + [*self.elbows]
        self.trail.points = np.stack([points[:-1], points[1:]], axis=1)
        self._show_zeta(seen["servo_state"], seen["singularity"], p)
        J = self.robot.arm.at(q).J[:3]
        squares, axes = np.linalg.eigh(J @ J.T)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        radii = 0.3 * np.sqrt(np.maximum(squares, 0)) + 1e-3
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
