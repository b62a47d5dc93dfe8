"""Listens to the run that is alive, from outside its graph: `python3 listen.py` beside `armplane run --mode realtime`."""

import armplane

count, most = 0, 0.0
for torque in armplane.subscribe("torque"):
    count += 1
    most = max(most, *(abs(tau) for tau in torque.tau))
print(f"{count} torques, at most {most:.1f} N·m")
