"""Message logs (`messages/TOPIC.log` of a run): every message as it was on the wire, as a numpy array."""

import struct

import numpy as np

from . import wire

_MARK = b"armkept\x02"


def _lz4(packed):
    """The content of an LZ4 block."""
    out, i, end = bytearray(), 0, len(packed)
    while i < end:
        token = packed[i]
        i += 1
        literals = token >> 4
        if literals == 15:
            while True:
                literals += packed[i]
                i += 1
                if packed[i - 1] != 255:
                    break
        out += packed[i : i + literals]
        i += literals
        if i >= end:
            break
        distance = packed[i] | packed[i + 1] << 8
        i += 2
        length = (token & 15) + 4
        if length == 19:
            while True:
                length += packed[i]
                i += 1
                if packed[i - 1] != 255:
                    break
        start = len(out) - distance
        while length > 0:
            part = out[start : start + length]
            out += part
            length -= len(part)
            start += len(part)
    return out


def read(path, topic):
    """All messages of a topic, in order: a structured array with the fields of `armplane.wire`, nested ones too."""
    structure, type_name, layout = wire.TOPICS[topic]
    dtype = np.dtype(structure)
    with open(path, "rb") as file:
        raw = file.read()
    found, size = struct.unpack_from("<QI", raw, 8)
    if raw[:8] != _MARK or found != layout or size != dtype.itemsize:
        raise ValueError(f"{path} holds no {type_name} ({found:016x}, this package reads {layout:016x}): use the package of that armplane")
    words, blocks, at = size // 8, [], 24
    while at + 8 <= len(raw):
        n, length = struct.unpack_from("<II", raw, at)
        if at + 8 + length > len(raw):
            break  # what a killed writer began
        planes = np.frombuffer(bytes(_lz4(raw[at + 8 : at + 8 + length])), np.uint8)
        at += 8 + length
        rows, used = np.zeros((n, words), np.uint64), words
        for word in np.flatnonzero(planes[:words]):
            for byte in range(8):
                if planes[word] & 1 << byte:
                    rows[:, word] |= planes[used : used + n].astype(np.uint64) << np.uint64(8 * byte)
                    used += n
        # Zig-zag and differences, undone.
        one = np.uint64(1)
        blocks.append(np.cumsum((rows >> one) ^ (np.uint64(0) - (rows & one)), axis=0, dtype=np.uint64))
    whole = np.concatenate(blocks) if blocks else np.zeros((0, words), np.uint64)
    return np.ascontiguousarray(whole).view(dtype).reshape(-1)
