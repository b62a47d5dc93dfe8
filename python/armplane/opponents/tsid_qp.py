"""TSID 1.7.1: inverse dynamics as one QP, which tracks the hand and the posture within limits of speed and torque. Numbers: its exercise with a UR5
(exercizes/ur5_conf.py), which tracks the position alone; here the orientation too, and the whole of the limits."""

import numpy as np
import pinocchio
from tsid import tsid_pywrap as tsid

from armplane.arena import Torque, grid


class Tsid(Torque):
    kp_ee, kp_posture, w_posture = 5.0, 1.0, 1e-3
    trials = grid(kp_ee=(5.0, 100.0, 400.0), w_posture=(1e-3, 1e-6))

    def setup(self, arm):
        self.robot = robot = tsid.RobotWrapper(arm.pinocchio(), tsid.RootJointType.FIXED_BASE_SYSTEM, False)
        self.hand, posture = tsid.TaskSE3Equality("hand", robot, "end_effector"), tsid.TaskJointPosture("posture", robot)
        self.hand.useLocalFrame(False)
        for task, kp in (self.hand, self.kp_ee), (posture, self.kp_posture):
            task.setKp(np.full(task.dim, kp))
            task.setKd(np.full(task.dim, 2 * np.sqrt(kp)))
        posture.setReference(tsid.TrajectoryEuclidianConstant("start", arm.start).computeNext())
        torques, speeds = tsid.TaskActuationBounds("torques", robot), tsid.TaskJointBounds("speeds", robot, self.dt)
        torques.setBounds(*self._within(arm.effort))
        speeds.setVelocityBounds(*self._within(arm.velocity))
        self.problem = problem = tsid.InverseDynamicsFormulationAccForce("law", robot, False)
        problem.computeProblemData(0.0, arm.start, np.zeros(arm.n))
        # Weight and level: limits are kept before all else.
        problem.addMotionTask(self.hand, 1.0, 1, 0.0)
        problem.addMotionTask(posture, self.w_posture, 1, 0.0)
        problem.addActuationTask(torques, 1.0, 0, 0.0)
        problem.addMotionTask(speeds, 1.0, 0, 0.0)
        self.solver = tsid.SolverHQuadProgFast("qp")
        self.solver.resize(problem.nVar, problem.nEq, problem.nIn)
        self.kept, self.ref = (posture, torques, speeds), tsid.TrajectorySample(12, 6)

    @staticmethod
    def _within(limits):
        # Its QP takes no infinite bound.
        most = np.minimum(limits, 1e6)
        return -most, most

    def torque(self, q, qdot, ref):
        self.ref.pos(pinocchio.SE3(ref.R, ref.p))
        self.ref.vel(ref.V)
        self.ref.acc(ref.a)
        self.hand.setReference(self.ref)
        solution = self.solver.solve(self.problem.computeProblemData(0.0, q, qdot))
        if solution.status != 0:
            # As its exercise: the end.
            raise RuntimeError(f"the QP could not be solved (status {solution.status})")
        return self.problem.getActuatorForces(solution)
