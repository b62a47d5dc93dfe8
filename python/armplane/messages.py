"""Message logs (`messages/TOPIC.log` of a run): every message as it was on the wire, as a numpy array."""

import struct
import zlib

import numpy as np

from . import wire

_MARK = b"armkept\x03"


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
    while at + 16 <= len(raw):
        n, length, plain, checksum = struct.unpack_from("<IIII", raw, at)
        begin, end = at + 16, at + 16 + length + n * plain
        if end > len(raw):
            break  # what a killed writer began
        if zlib.crc32(raw[begin:end], zlib.crc32(raw[at : at + 12])) != checksum:
            raise ValueError(f"{path} is damaged: the block at byte {at} is not what was written")
        unpacked = np.frombuffer(bytes(_lz4(raw[begin : begin + length])), np.uint8)
        present, as_they_are, twins = unpacked[:words], unpacked[words : 2 * words], unpacked[2 * words : 4 * words].view("<u2")
        packed, noise = unpacked[4 * words :], np.frombuffer(raw[begin + length : end], np.uint8)
        at, rows, used, taken = end, np.zeros((n, words), np.uint64), 0, 0
        for word in range(words):
            if twins[word]:
                rows[:, word] = rows[:, twins[word] - 1]
            for byte in range(8):
                if not present[word] & 1 << byte:
                    continue
                if as_they_are[word] & 1 << byte:
                    plane, taken = noise[taken : taken + n], taken + n
                else:
                    plane, used = packed[used : used + n], used + n
                rows[:, word] |= plane.astype(np.uint64) << np.uint64(8 * byte)
        # Zig-zag and differences, undone.
        one = np.uint64(1)
        blocks.append(np.cumsum((rows >> one) ^ (np.uint64(0) - (rows & one)), axis=0, dtype=np.uint64))
    whole = np.concatenate(blocks) if blocks else np.zeros((0, words), np.uint64)
    return np.ascontiguousarray(whole).view(dtype).reshape(-1)
