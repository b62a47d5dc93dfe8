"""Isaac Lab's operational-space controller with the conditioning of isaac-sim/IsaacLab#7903, after its description, in our words: an eigenvalue of J A⁻¹ Jᵀ is damped
where it is below 1e-4 of the largest, fully below 1e-5."""

from armplane.opponents.isaac_lab_osc import Osc


class Damped(Osc):
    thresholds = (1e-5, 1e-4)
