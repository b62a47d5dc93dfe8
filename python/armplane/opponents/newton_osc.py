"""newton 1.8.0: its operational-space controller (newton.controllers) on the CPU, with the gains of its example (controllers/example_controller_operational_space_
hybrid_force_motion.py), critically damped. It has a port for the reference's twist; the acceleration goes through it too, which Newton's example does not do. The
example controls no null space: of an arm with spare joints it has the numbers of Isaac Lab's controller."""

import gc

import numpy as np
import warp as wp
from newton.controllers import ControllerOperationalSpaceModelFree
from scipy.spatial.transform import Rotation

from armplane.arena import Torque


class Osc(Torque):
    stiffness, null_stiffness, partial = 600.0, 10.0, False
    trials = [{"stiffness": stiffness, "partial": partial} for stiffness in (150.0, 600.0, 2400.0) for partial in (False, True)]

    def setup(self, arm):
        wp.config.log_level = wp.LOG_ERROR
        self.damping = 2 * np.sqrt(self.stiffness)
        spare = {"use_null_space_control": True, "null_space_stiffness": self.null_stiffness, "null_space_damping": 2 * np.sqrt(self.null_stiffness)}
        self.controller = ControllerOperationalSpaceModelFree(
            controlled_dofs_per_robot=wp.array([arm.n], dtype=wp.int32, device="cpu"),
            motion_stiffness=self.stiffness,
            motion_damping=float(self.damping),
            use_partial_inertia_decoupling=self.partial,
            device="cpu",
            **(spare if arm.n > 6 else {}),
        )
        self.inputs, self.outputs = self.controller.input(), self.controller.output()
        # Its arrays as numpy sees them: on the CPU the same memory.
        self.ports = {name: port.numpy() for name, port in vars(self.inputs).items() if isinstance(port, wp.array)}
        if arm.n > 6:
            self.ports["joint_q_des_null"][:] = arm.start
        # Compiles. Python would take apart what this leaves for longer at the end than a process of a run has to stop.
        self.controller.step(inputs=self.inputs, outputs=self.outputs, dt=self.dt)
        gc.freeze()

    def torque(self, q, qdot, ref):
        arm = self.arm
        J = arm.J(q)
        here, there = (np.concatenate([p, Rotation.from_matrix(R).as_quat()]) for R, p in (arm.pose(q), (ref.R, ref.p)))
        values = {"tool_pose_world": here, "tool_twist_world": J @ qdot, "jacobian_tool_world": J, "mass_matrix": arm.A(q), "joint_q": q, "joint_qd": qdot}
        values |= {"desired_tool_pose_operational": there, "desired_twist_operational": ref.V + ref.a / self.damping}
        arm.move_to(q, 0 * qdot)
        values["gravity_force"] = arm.bias()
        for name, port in self.ports.items():
            if name in values:
                port[:] = values[name]
        self.controller.step(inputs=self.inputs, outputs=self.outputs, dt=self.dt)
        return self.outputs.joint_f.numpy()
