"""Watches a run: prints, once a second of the arm's time, where the hand is and how much power the drives give."""

from __future__ import annotations

import armplane
from armplane import wire


class Watch(armplane.Observer):
    most = 0.0

    def see(self, tick: int, plant_state: wire.PlantState | None = None, torque: wire.TorqueCommand | None = None) -> None:
        if plant_state is None or torque is None:
            return
        power = sum(tau * rate for tau, rate in zip(torque.tau, plant_state.qdot))
        self.most = max(self.most, power)
        if tick % 1000 == 0:
            x, y, z = plant_state.p_BE
            print(f"{tick * self.dt:.0f} s: hand at {x:+.3f} {y:+.3f} {z:+.3f} m, at most {self.most:.1f} W so far")


if __name__ == "__main__":
    Watch.run()
