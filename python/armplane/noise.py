"""The simulator's random numbers: a function of seed, tick and channel alone, the same as armplane's own plant draws."""

import numpy as np

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_A, _B = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _12 = (np.uint64(n) for n in (30, 27, 31, 12))


def _mix(state):
    z = state + _GOLDEN
    z = (z ^ (z >> _30)) * _A
    z = (z ^ (z >> _27)) * _B
    return z ^ (z >> _31)


def _unit(bits):
    return ((bits >> _12).astype(np.float64) + 0.5) * 2.0**-52


class Gaussian:
    """Standard normal numbers of `channels` channels (Box and Muller)."""

    def __init__(self, seed, channels):
        self._channels = np.arange(channels, dtype=np.uint64)
        self._seed = _mix(np.array([seed], dtype=np.uint64))

    def __call__(self, tick):
        key = _mix(_mix(self._seed ^ np.uint64(tick)) ^ self._channels)
        u_1, u_2 = _unit(_mix(key)), _unit(_mix(key ^ np.uint64(0x5851F42D4C957F2D)))
        return np.sqrt(-2.0 * np.log(u_1)) * np.cos(2.0 * np.pi * u_2)
