"""newton 1.8.0: its operational-space controller (newton.controllers) on the CPU, with the gains of its example (controllers/example_controller_operational_space_
hybrid_force_motion.py), critically damped. It has a port for the reference's twist; the acceleration goes through it too, which Newton's example does not do. The
example controls no null space: of an arm with spare joints it has the numbers of Isaac Lab's controller. It presses as the example does."""

import numpy as np
import warp as wp
from newton.controllers import ControllerOperationalSpaceModelFree
from scipy.spatial.transform import Rotation

from armplane.arena import Torque, grid


class Osc(Torque):
    stiffness, null_stiffness, partial = 600.0, 10.0, False
    # Of the axis along which it presses: that of the motion, which is to damp, and that of the force's error.
    pressing_stiffness, wrench_stiffness = 50.0, 0.5
    presses = True
    trials = grid(stiffness=(150.0, 600.0, 2400.0), partial=(False, True))

    def setup(self, arm):
        wp.config.log_level = wp.LOG_ERROR
        self.damping = 2 * np.sqrt(self.stiffness)
        self.motion = self._solver(motion_stiffness=self.stiffness, motion_damping=float(self.damping))
        if any(segment.get("force") for segment in self.scenario["segment"]):
            gains = np.array([self.stiffness, self.stiffness, self.pressing_stiffness, *[self.stiffness] * 3])
            self.hybrid = self._solver(
                motion_stiffness=wp.spatial_vector(*gains),
                motion_damping=wp.spatial_vector(*(2 * np.sqrt(gains))),
                operational_frame_pose_world=None,
                use_wrench_feedforward=True,
                use_wrench_feedback=True,
                wrench_stiffness=self.wrench_stiffness,
                wrench_selection_axes=wp.spatial_vector(0, 0, 1, 0, 0, 0),
            )

    def _solver(self, **more):
        """A function from the values of its ports to the torques."""
        n = self.arm.n
        spare = {"use_null_space_control": True, "null_space_stiffness": self.null_stiffness, "null_space_damping": 2 * np.sqrt(self.null_stiffness)}
        controller = ControllerOperationalSpaceModelFree(
            controlled_dofs_per_robot=wp.array([n], dtype=wp.int32, device="cpu"),
            use_partial_inertia_decoupling=self.partial,
            device="cpu",
            **(spare if n > 6 else {}),
            **more,
        )
        inputs, outputs = controller.input(), controller.output()
        # Its arrays as numpy sees them: on the CPU the same memory.
        ports = {name: port.numpy() for name, port in vars(inputs).items() if isinstance(port, wp.array)}
        if n > 6:
            ports["joint_q_des_null"][:] = self.arm.start

        def answer(**values):
            for name in ports.keys() & values.keys():
                ports[name][:] = values[name]
            controller.step(inputs=inputs, outputs=outputs, dt=self.dt)
            return outputs.joint_f.numpy()

        # Compiles.
        answer()
        return answer

    def torque(self, q, qdot, ref):
        arm, force, V = self.arm, ref.force, ref.V + ref.a / self.damping
        J = arm.J(q)
        values = {"tool_pose_world": _place(*arm.pose(q)), "tool_twist_world": J @ qdot, "jacobian_tool_world": J, "mass_matrix": arm.A(q), "joint_q": q, "joint_qd": qdot}
        arm.move_to(q, 0 * qdot)
        values["gravity_force"] = arm.bias()
        if force is None:
            return self.motion(**values, desired_tool_pose_operational=_place(ref.R, ref.p), desired_twist_operational=V)
        # Its frame has its z along the axis, and its target is on the surface.
        ref.lead(force.axis, force.surface, 0.0)
        R = Rotation.align_vectors([force.axis], [[0, 0, 1]])[0].as_matrix()
        return self.hybrid(
            **values,
            operational_frame_pose_world=_place(R, np.zeros(3)),
            desired_tool_pose_operational=_place(R.T @ ref.R, R.T @ ref.p),
            desired_twist_operational=np.kron(np.eye(2), R.T) @ V,
            desired_wrench_world=[*(force.newtons * force.axis), 0, 0, 0],
            measured_wrench_world=[*(force.pressed * force.axis), 0, 0, 0],
        )


def _place(R, p):
    return np.concatenate([p, Rotation.from_matrix(R).as_quat()])
