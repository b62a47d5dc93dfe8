"""The message log of a run, `messages.mcap`: every message, as a numpy array. Needs the package `mcap`."""

import numpy as np
from mcap.reader import make_reader

from . import wire


def read(path, topic):
    """All messages of a topic, in order: a structured array with the fields of `armplane.wire`, nested ones too.

    Raises ValueError where the messages are of another layout. `armplane replay` and `armplane recover` say what a log lacks.
    """
    if topic not in wire.TOPICS:
        raise KeyError(f"there is no topic {topic!r}: there are {', '.join(wire.TOPICS)}")
    structure, type_name, _ = wire.TOPICS[topic]
    dtype = np.dtype(structure)
    with open(path, "rb") as file:
        rows = [message.data[4:] for _, _, message in make_reader(file, validate_crcs=True).iter_messages([f"/{topic}"], log_time_order=False)]
    if any(len(row) != dtype.itemsize for row in rows):
        raise ValueError(f"{path} holds no {type_name}: use the package of the armplane that made the run")
    return np.frombuffer(b"".join(rows), dtype)
