"""MuJoCo as the plant of a run, `armplane run SCENARIO --plant mujoco[:scene.xml]`, and the arm of a run in MuJoCo for processes in Python."""

import json
import math
import os
import sys

try:
    import mujoco
    import numpy as np
    from numpy.linalg import norm
except ImportError as error:
    if __name__ != "__main__":
        raise
    sys.exit(f"{error}: pip install mujoco, for the Python {sys.executable}")

from .drive import Drive, mask
from .limited import Ended, limited
from .process import Plant

# A scene whose joints lie further from the robot's (m, or rad of their axes) is another arm.
_SAME = 1e-5
# Of the robot's inertia: with less, the law's gains are too high.
_LIGHT = 0.5
# All of the simulation that the next step depends on.
_ALL = mujoco.mjtState.mjSTATE_INTEGRATION
# A contact's surface counts as sliding from this speed on; m/s.
_SLIDING = 5e-3
# Longest time in which a scene is read and compiled, s: one can be endless, or say that a body is there a billion times.
_LONGEST_S = 60
_BAD = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


class Arm:
    """The arm alone, from `Process.mjcf()`, at the scenario's start: `model`, `data`, and what armplane's messages say of a posture."""

    def __init__(self, text):
        self.model = m = mujoco.MjModel.from_xml_string(text)
        # Joints beyond their stops are the simulation's, not the model's.
        m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        m.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        self.data, self.n = mujoco.MjData(m), m.nv
        self.names = [m.joint(j).name for j in range(m.njnt)]
        self.turns = m.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
        self.effort = np.where(m.jnt_actfrclimited, m.jnt_actfrcrange[:, 1], np.inf)
        self.velocity = np.where(m.jnt_user[:, 0] > 0, m.jnt_user[:, 0], np.inf) if m.nuser_jnt else np.full(self.n, np.inf)
        self.frame = m.site("end_effector").id
        self.start = m.key("start").qpos.copy()
        self._jacobian = np.zeros((6, self.n))
        self.move_to(self.start)

    def move_to(self, q, qdot=None):
        """Places the arm; the kinematics and the bias force are those of the new state."""
        self.data.qpos[:] = q
        self.data.qvel[:] = 0 if qdot is None else qdot
        mujoco.mj_forward(self.model, self.data)

    @property
    def position(self):
        """The end-effector's position in B; m."""
        return self.data.site_xpos[self.frame]

    @property
    def rotation(self):
        """The end-effector's rotation in B, 3 × 3."""
        return self.data.site_xmat[self.frame].reshape(3, 3)

    def jacobian(self):
        """J at the end-effector, 6 × n, [linear; angular] in base axes."""
        mujoco.mj_jacSite(self.model, self.data, self._jacobian[:3], self._jacobian[3:], self.frame)
        return self._jacobian

    def mass_matrix(self):
        """A(q), n × n; kg·m²."""
        return _mass_matrix(self.model, self.data)

    def bias(self):
        """Torque of gravity and of Coriolis and centrifugal forces; N·m."""
        return self.data.qfrc_bias


def _mass_matrix(model, data):
    A = np.zeros((model.nv, model.nv))
    for i, unit in enumerate(np.eye(model.nv)):
        mujoco.mj_mulM(model, data, A[i], unit)
    return A


def _spec(arm_text, file):
    """The scene's file; without one the arm's model, which touches nothing."""
    if file and os.path.exists(file) and not os.path.isfile(file):
        raise ValueError("it is no regular file")
    if file:
        return mujoco.MjSpec.from_file(file)
    spec = mujoco.MjSpec.from_string(arm_text)
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    return spec


def _without_self_collision(spec, names):
    """Takes contacts among the arm's own bodies out of the scene, those of the link at its base included."""

    def rigid(body):
        yield body
        for child in body.bodies:
            if not list(child.joints):
                yield from rigid(child)

    links = [spec.joint(name).parent for name in names]
    base = links[0].parent
    bodies = ([] if base.name == "world" else [base]) + [body for link in links for body in rigid(link)]
    for i, body in enumerate(bodies):
        body.name = body.name or f"armplane {i}"
    for i, body in enumerate(bodies):
        for other in bodies[:i]:
            spec.add_exclude(bodyname1=body.name, bodyname2=other.name)


def _pressing(surfaces, p, v):
    """Which of the scenario's surfaces a point at `p` with velocity `v` touches, and the force on it, N: the same springs as in armplane's own plant
    (sim/src/surface.rs)."""
    touched, force = set(), np.zeros(3)
    for i, one in enumerate(surfaces):
        way, radius = p - one["point_m"], one.get("radius_m")
        normal = way if radius else np.array(one["normal"], float)
        normal = normal / norm(normal)
        depth = radius - norm(way) if radius else -normal @ way
        if depth > 0:
            inwards = -normal @ v
            sliding = v + inwards * normal
            pressing = one["stiffness_n_m"] * depth * max(0, 1 + one["damping_s_m"] * inwards)
            force += pressing * (normal - sliding * one["friction"] / max(norm(sliding), _SLIDING))
            touched.add(i)
    return touched, force


class World:
    """The simulation: the arm's joints by name in a scene, torques at them, everything else as the scene has it.

    `said` lists what differs from the scene's file and from the robot's model. Raises ValueError, with the reason in words, where they do not fit.
    """

    def __init__(self, job, arm_text, file=None):
        scenario, self.arm, self.robot = job["scenario"], Arm(arm_text), job["robot"]["name"]
        self.where, self.said = os.path.basename(file) if file else self.robot, []
        options = scenario["plant"]
        self.surfaces = options.get("surface", [])
        # The points of the hand that touch them, in its axes: E, or the rim of its face.
        radius, turns = options["face_radius_m"], np.arange(8) * np.pi / 4
        self.touching = radius * np.array([np.cos(turns), np.sin(turns), 0 * turns]).T if radius else np.zeros((1, 3))
        try:
            spec = _spec(arm_text, file)
            self._find(spec)
            if not options["self_collision"]:
                _without_self_collision(spec, self.arm.names)
            self.model = spec.compile()
        except ValueError as error:
            raise ValueError(f"{self.where}: {' '.join(str(error).split())}") from None
        m = self.model
        self.data = mujoco.MjData(m)
        self.joints = np.array([m.joint(name).id for name in self.arm.names])
        self.qpos, self.dofs = m.jnt_qposadr[self.joints], m.jnt_dofadr[self.joints]
        self._check_chain()
        self._take_over_torques()
        self._take_off_forces(options["friction"])
        mass_factor = options["mass_factor"]
        if mass_factor != 1:
            m.body_mass[self.tree] *= mass_factor
            m.body_inertia[self.tree] *= mass_factor
            mujoco.mj_setConst(m, self.data)
        dt = 1 / scenario["rate_hz"]
        self.substeps = max(options["substeps"], math.ceil(dt / m.opt.timestep))
        m.opt.timestep = dt / self.substeps
        mujoco.mj_resetData(m, self.data)
        self._compare_with_model()
        self.data.qpos[self.qpos] = self.arm.start
        mujoco.mj_forward(m, self.data)

    def _find(self, spec):
        for joint in spec.joints:
            joint.name = joint.name or f"joint of {joint.parent.name}"
        known = [joint.name for joint in spec.joints]
        for name in self.arm.names:
            if name not in known:
                raise ValueError(f"there is no joint {name!r}; the arm's joints are found by their names, and there are {', '.join(known)}")

    def _check_chain(self):
        m = self.model
        for name, joint, dof, parent, turns in zip(self.arm.names, self.joints, self.dofs, [-1, *self.dofs], self.arm.turns):
            if m.dof_parentid[dof] != parent:
                other = m.joint(m.dof_jntid[m.dof_parentid[dof]]).name if m.dof_parentid[dof] >= 0 else "none"
                wanted = "the world" if parent < 0 else m.joint(m.dof_jntid[parent]).name
                raise ValueError(f"{self.where}: joint {name} moves on joint {other}, and the robot's on {wanted}: a base or joint between must be fixed")
            if m.jnt_type[joint] != (mujoco.mjtJoint.mjJNT_HINGE if turns else mujoco.mjtJoint.mjJNT_SLIDE):
                raise ValueError(f"{self.where}: joint {name} is of another kind than the robot's")
        self.tree = np.flatnonzero(m.body_treeid == m.body_treeid[m.jnt_bodyid[self.joints[0]]])

    def _take_over_torques(self):
        """Actuators of the arm's joints exert no force: the torques come from the controller."""
        m, d = self.model, self.data
        mujoco.mj_forward(m, d)
        moment = np.zeros((len(d.moment_rownnz), m.nv))
        mujoco.mju_sparse2dense(moment, d.actuator_moment, d.moment_rownnz, d.moment_rowadr, d.moment_colind)
        outputs = getattr(m, "actuator_outnum", np.ones(len(moment), int))
        kinds = {}
        for a, rows in enumerate(np.split(moment != 0, np.cumsum(outputs)[:-1]) if len(moment) else []):
            acts_on, name = np.flatnonzero(rows.any(axis=0)), m.actuator(a).name or f"number {a + 1}"
            if not np.isin(acts_on, self.dofs).any():
                continue
            if not np.isin(acts_on, self.dofs).all():
                raise ValueError(f"{self.where}: the actuator {name} drives joints of the arm and others at once: take it out")
            bias = m.actuator_biasprm[a]
            kind = "motor" if m.actuator_biastype[a] == 0 else "position" if bias[1] else "velocity" if bias[2] else "general"
            kinds[kind] = kinds.get(kind, 0) + 1
            m.actuator_gaintype[a] = m.actuator_biastype[a] = 0
            m.actuator_gainprm[a] = m.actuator_biasprm[a] = 0
            self._zero(("actuator_damping", "actuator_dampingpoly"), a)
        if kinds:
            self.said.append("torques in place of " + ", ".join(f"{count} {kind} actuators" for kind, count in kinds.items()))

    def _zero(self, names, places):
        """Sets numbers of the model to zero, those that this version of MuJoCo knows; whether one was not."""
        arrays = [getattr(self.model, name) for name in names if hasattr(self.model, name)]
        was_set = any(np.any(array[places]) for array in arrays)
        for array in arrays:
            array[places] = 0
        return was_set

    def _take_off_forces(self, has_friction):
        """The robot's model knows neither springs nor gravity compensation; friction acts where the scenario says so."""
        forces = {
            "gravity compensation": (("body_gravcomp",), self.tree),
            "springs": (("jnt_stiffness", "jnt_stiffnesspoly"), self.joints),
            "damping and dry friction (plant.friction = false)": ((() if has_friction else ("dof_damping", "dof_dampingpoly", "dof_frictionloss")), self.dofs),
        }
        if off := [force for force, where in forces.items() if self._zero(*where)]:
            self.said.append(f"without {', '.join(off)} of its joints")

    def _compare_with_model(self):
        """Finds the robot's base in the scene, and how far the two arms differ."""
        m, d, arm = self.model, self.data, self.arm
        lower, upper = (np.where(arm.model.jnt_limited, side, sign * 3) for side, sign in zip(arm.model.jnt_range.T, (-1, 1)))
        postures = [arm.start, *np.random.default_rng(0).uniform(lower, upper, (4, arm.n))]
        body, first = m.jnt_bodyid[self.joints[0]], arm.model.jnt_bodyid[0]
        bases, worst = [], np.zeros((2, arm.n))
        for posture in postures:
            d.qpos[self.qpos] = posture
            mujoco.mj_kinematics(m, d)
            arm.move_to(posture)
            if not bases:
                R = d.xmat[body].reshape(3, 3) @ arm.data.xmat[first].reshape(3, 3).T
                bases = [(np.eye(3), np.zeros(3)), (R, d.xpos[body] - R @ arm.data.xpos[first])]
            for k, (R, p) in enumerate(bases):
                axes, ours = d.xaxis[self.joints], arm.data.xaxis @ R.T
                apart = np.cross(d.xanchor[self.joints] - (arm.data.xanchor @ R.T + p), axes)
                worst[k] = np.maximum.reduce([worst[k], np.abs(axes - ours).max(axis=1), np.abs(apart).max(axis=1) * arm.turns])
        best = worst.max(axis=1).argmin()
        self.base, far = bases[best][0], worst[best]
        if far.max() > _SAME:
            name = arm.names[int(np.argmax(far > _SAME))]
            raise ValueError(f"{self.where}: the axis of joint {name} lies {far.max():.2g} m or rad from that of {self.robot}: it is another arm")
        tilt = np.abs(self.base.T @ m.opt.gravity - arm.model.opt.gravity).max()
        if tilt > _SAME:
            raise ValueError(f"{self.where}: gravity at the arm's base differs by {tilt:.2g} m/s² from that of {self.robot}: mount it upright, or state gravity")
        d.qpos[self.qpos] = arm.start
        arm.move_to(arm.start)
        mujoco.mj_forward(m, d)
        share = _mass_matrix(m, d).diagonal()[self.dofs] / arm.mass_matrix().diagonal()
        load = np.abs(d.qfrc_bias[self.dofs] - arm.bias()).max()
        if share.min() < _LIGHT:
            name = arm.names[int(share.argmin())]
            raise ValueError(
                f"{self.where}: joint {name} has {share.min():.0%} of the inertia it has in {self.robot}, so that the law's torques would shake it: "
                "state the same armature in both"
            )
        if np.abs(share - 1).max() > 1e-6 or load > 1e-6:
            self.said.append(f"at the start its joints have {share.min():.1%} to {share.max():.1%} of the robot's inertia, and {load:.2g} N·m more or less weight")
        if (pushed := np.abs(d.qfrc_constraint[self.dofs] + d.qfrc_passive[self.dofs])).max() > 1e-6:
            self.said.append(f"at the start something pushes joint {arm.names[int(pushed.argmax())]} with {pushed.max():.2g} N·m")

    @property
    def q(self):
        return self.data.qpos[self.qpos]

    @property
    def qdot(self):
        return self.data.qvel[self.dofs]

    def step(self, tau):
        """One tick under the torques `tau`, N·m, and the wrench of the surfaces at the beginning of each sub-step. `None`: the brakes hold the arm."""
        d, q = self.data, self.q
        for _ in range(self.substeps):
            if tau is not None:
                d.qfrc_applied[self.dofs] = tau + (self.arm.jacobian().T @ self.pressed()[1] if self.surfaces else 0)
            mujoco.mj_step(self.model, d)
            if tau is None:
                d.qpos[self.qpos], d.qvel[self.dofs] = q, 0
            elif self.surfaces:
                self.arm.move_to(self.q, self.qdot)
        if any(d.warning[bad].number for bad in _BAD):
            raise RuntimeError(f"MuJoCo's simulation left the finite numbers at {d.time:.3f} s: more sub-steps (plant.substeps), or a softer scene")
        self.arm.move_to(self.q, self.qdot)

    def pressed(self):
        """Number of surfaces that the hand touches, and the wrench on it about E in base axes; N, N·m."""
        touched, wrench, V = set(), np.zeros(6), self.arm.jacobian() @ self.qdot
        for lever in self.touching @ self.arm.rotation.T:
            surfaces, force = _pressing(self.surfaces, self.arm.position + lever, V[:3] + np.cross(V[3:], lever))
            touched |= surfaces
            wrench += np.concatenate([force, np.cross(lever, force)]) / len(self.touching)
        return len(touched), wrench

    def state(self):
        state = np.zeros(mujoco.mj_stateSize(self.model, _ALL))
        mujoco.mj_getState(self.model, self.data, state, _ALL)
        return state.tobytes()

    def restore(self, state):
        """Goes on from the bytes that `state` gave, and returns those behind them."""
        numbers = mujoco.mj_stateSize(self.model, _ALL)
        mujoco.mj_setState(self.model, self.data, np.frombuffer(state, count=numbers), _ALL)
        self.arm.move_to(self.q, self.qdot)
        return state[8 * numbers :]

    def limit_mask(self):
        """Bit i: joint i is at its stop."""
        m, q = self.model, self.q
        lower, upper = m.jnt_range[self.joints].T
        return mask(m.jnt_limited[self.joints].astype(bool) & ((q <= lower) | (q >= upper)))

    def touch(self):
        """Number of contacts of the arm, and the force on it in base axes; N."""
        m, d, force, count, one = self.model, self.data, np.zeros(3), 0, np.zeros(6)
        for i in range(d.ncon):
            of_arm = [bool(np.isin(m.geom_bodyid[geom], self.tree)) for geom in d.contact[i].geom]
            if any(of_arm) and d.contact[i].dist < 0:
                mujoco.mj_contactForce(m, d, i, one)
                # From the first geom to the second.
                force += (of_arm[1] - of_arm[0]) * (one[:3] @ d.contact[i].frame.reshape(3, 3))
                count += 1
        touched, pressed = self.pressed()
        return count + touched, self.base.T @ force + pressed[:3]

    def __str__(self):
        m = self.model
        integrator = mujoco.mjtIntegrator(m.opt.integrator).name.removeprefix("mjINT_")
        steps = f"{self.substeps} steps of {1e3 * m.opt.timestep:g} ms a tick ({integrator})"
        return "; ".join([f"MuJoCo {mujoco.__version__}, {self.where}: {steps}", *self.said])


class MujocoPlant(Plant):
    """armplane's own drives and encoders around MuJoCo's arm."""

    def setup(self):
        plant = self.job["scenario"]["plant"]
        self.world = World(self.job, self.mjcf(), *sys.argv[1:2])
        arm = self.world.arm
        self.drive = Drive(arm.effort, arm.velocity, self.dt, plant["hold_ticks"], arm.bias().copy())
        bits = plant["encoder_bits"]
        self.count = np.where(arm.turns, 2 * np.pi, 1) / 2**bits if bits else None
        print(self.world)

    def state(self):
        return self.world.state() + self.drive.state_bytes()

    def restore(self, state):
        self.drive.restore(self.world.restore(state))

    def step(self, torque):
        world, arm = self.world, self.world.arm
        age = self.now.tick - 1 - torque.header.tick if torque else 0
        command = np.array(torque.tau[: arm.n]) if torque else None
        gravity, inertia = (arm.bias(), arm.mass_matrix().diagonal()) if command is None else (None, None)
        tau = self.drive.answer(command, age, world.qdot, gravity, inertia)
        world.step(None if self.drive.braked else tau)

    def sample(self, tick, sensor, truth):
        world, arm, drive, plant = self.world, self.world.arm, self.drive, self.job["scenario"]["plant"]
        n, q, qdot = arm.n, world.q, world.qdot
        # A function of seed and tick alone: after a death, the same readings come again.
        noise = np.random.default_rng((self.job["scenario"]["seed"], tick)).standard_normal(n + 6)
        sensor.q_encoder[:n] = q if self.count is None else self.count * np.round(q / self.count + plant["encoder_noise_counts"] * noise[:n])
        sensor.tau_drive[:n] = truth.tau[:n] = drive.tau
        sensor.drive, sensor.stale_ticks = truth.drive, _ = drive.state, drive.stale_ticks
        truth.q[:n], truth.qdot[:n], truth.p_BE[:], truth.R_BE[:], truth.V_BE[:] = q, qdot, arm.position, arm.rotation.T.flatten(), arm.jacobian() @ qdot
        truth.energy_j = arm.data.energy.sum()
        truth.contacts, truth.contact_force_n[:] = world.touch()
        wrench = world.pressed()[1]
        truth.contact_torque_nm[:] = wrench[3:]
        if (wrist := self.topics.get("wrist_force")) is not None:
            wrist.force_n[:] = wrench[:3] + plant["wrist_noise_n"] * noise[n : n + 3]
            wrist.torque_nm[:] = wrench[3:] + plant["wrist_noise_nm"] * noise[n + 3 :]
        truth.limit_mask = world.limit_mask()
        truth.drive_flags, truth.saturation_mask, truth.refused = drive.flags, drive.saturation_mask, drive.refused


def main():
    """Takes part in the run that started this program; without one, checks the scenario on standard input."""
    if not hasattr(getattr(mujoco, "MjSpec", None), "delete"):
        sys.exit(f"MuJoCo {mujoco.__version__} is too old: pip install 'mujoco>=3.3', for the Python {sys.executable}")
    if "ARMPLANE_PROCESS" in os.environ:
        MujocoPlant.run()
        return
    question, scene = json.load(sys.stdin), sys.argv[1:2]
    try:
        limited(_LONGEST_S, lambda: World(question, question["arm"], *scene) and None)
    except Ended as error:
        sys.exit(f"{scene[0] if scene else 'the arm'} {error}: give a smaller scene")
    except ValueError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
