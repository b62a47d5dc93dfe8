"""Rotation matrices, rotation vectors (axis times angle, rad) and quaternions."""

import numpy as np
from numpy.linalg import norm


def rotation_exp(turn):
    """The rotation by a rotation vector; rad."""
    angle = norm(turn)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = turn / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)


def rotation_of(quaternion):
    """The rotation matrix of a quaternion `w, x, y, z`, of any length but zero."""
    w, v = quaternion[0], np.array(quaternion[1:])
    size = norm(v)
    return rotation_exp(v * (2 * np.arctan2(size, w) / size)) if size > 1e-12 else np.eye(3)


def rotation_log(R):
    """The rotation vector of a rotation matrix; rad."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    sine, cosine = norm(axis), (np.trace(R) - 1) / 2
    if sine > 1e-9:
        return axis * (np.arctan2(sine, cosine) / sine)
    if cosine > 0:
        return axis
    # Half a turn: the axis is the eigenvector of 1.
    values, vectors = np.linalg.eigh((R + R.T) / 2)
    return np.pi * vectors[:, np.argmax(values)]
