"""Message logs (`messages/TOPIC.log` of a run): every message as it was on the wire, as a numpy array."""

import struct
import zlib

import numpy as np

from . import wire

_MARK = b"armkept\x05"


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
    """All messages of a topic, in order: a structured array with the fields of `armplane.wire`, nested ones too.

    Raises ValueError where a block is damaged, missing, repeated, out of its order, or of another run or log. A log that ends before the others of its run
    is not told from one whose writer was killed: `armplane replay` and `armplane recover` compare them.
    """
    structure, type_name, layout = wire.TOPICS[topic]
    dtype = np.dtype(structure)
    with open(path, "rb") as file:
        raw = file.read()
    if len(raw) < 40:
        raise ValueError(f"{path} is no message log: it ends after {len(raw)} bytes")
    found, size, log, logs, run, checksum = struct.unpack_from("<QIHHQI", raw, 8)
    if raw[:8] != _MARK or found != layout or size != dtype.itemsize:
        raise ValueError(f"{path} holds no {type_name} ({found:016x}, this package reads {layout:016x}): use the package of that armplane")
    if zlib.crc32(raw[:32]) != checksum:
        raise ValueError(f"{path} is damaged: its first bytes are not what was written")
    words, blocks, at, messages, head = size // 8, [], 40, 0, 52 + 8 * logs
    while at + head <= len(raw):
        n, length, plain, body, of_run, of_layout, of_log, of_logs, first, _, checksum = struct.unpack_from("<IIIIQIHHQQI", raw, at)
        if of_logs != logs or zlib.crc32(raw[at + 52 : at + head], zlib.crc32(raw[at : at + 48])) != checksum:
            raise ValueError(f"{path} is damaged: the block at byte {at} is not what was written")
        if (of_run, of_log, of_layout) != (run, log, layout & 0xFFFF_FFFF):
            raise ValueError(f"{path} is damaged: the block at byte {at} is of another run or another log")
        if first != messages:
            raise ValueError(f"{path} is damaged: the block at byte {at} begins with message {first}, message {messages} is missing")
        steps = max(n - 1, 0)
        begin, end = at + head, at + head + length + steps * plain
        if end > len(raw):
            break  # what a killed writer began
        if zlib.crc32(raw[begin:end]) != body:
            raise ValueError(f"{path} is damaged: the block at byte {at} is not what was written")
        messages += n
        if n == 0:
            at = end
            continue  # the end that its writer gave it
        unpacked = np.frombuffer(bytes(_lz4(raw[begin : begin + length])), np.uint8)
        present, as_they_are, twins = unpacked[:words], unpacked[words : 2 * words], unpacked[2 * words : 4 * words].view("<u2")
        packed, noise = unpacked[12 * words :], np.frombuffer(raw[begin + length : end], np.uint8)
        at, rows, used, taken = end, np.zeros((steps, words), np.uint64), 0, 0
        for word in range(words):
            if twins[word]:
                rows[:, word] = rows[:, twins[word] - 1]
            for byte in range(8):
                if not present[word] & 1 << byte:
                    continue
                if as_they_are[word] & 1 << byte:
                    plane, taken = noise[taken : taken + steps], taken + steps
                else:
                    plane, used = packed[used : used + steps], used + steps
                rows[:, word] |= plane.astype(np.uint64) << np.uint64(8 * byte)
        # Zig-zag and differences, undone.
        one, first = np.uint64(1), unpacked[4 * words : 12 * words].view("<u8")
        changes = (rows >> one) ^ (np.uint64(0) - (rows & one))
        blocks.append(np.cumsum(np.vstack([first, changes]), axis=0, dtype=np.uint64))
    whole = np.concatenate(blocks) if blocks else np.zeros((0, words), np.uint64)
    return np.ascontiguousarray(whole).view(dtype).reshape(-1)
