"""Message logs (`messages/TOPIC.log` of a run): every message as it was on the wire, as a numpy array."""

import struct
import zlib

import numpy as np

from . import wire

_MARK = b"armkept\x06"


def _masked(packed, at, length, steady=False):
    """`length` bytes of which a mask tells which are stored, and the place behind them. The others are zero, or `steady`: as the one before."""
    begin = at + (length + 7) // 8
    stored = np.unpackbits(packed[at:begin], count=length, bitorder="little").astype(bool)
    end = begin + int(stored.sum())
    if steady:
        # The number of the last byte stored so far; before the first one stands zero.
        return np.concatenate([np.zeros(1, np.uint8), packed[begin:end]])[np.cumsum(stored)], end
    plane = np.zeros(length, np.uint8)
    plane[stored] = packed[begin:end]
    return plane, end


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
    words, blocks, at, messages, head = size // 8, [], 40, 0, 48 + 8 * logs
    while at + head <= len(raw):
        n, length, body, of_layout, of_run, of_log, of_logs, first, _, checksum = struct.unpack_from("<IIIIQHHQQI", raw, at)
        if of_logs != logs or zlib.crc32(raw[at + 48 : at + head], zlib.crc32(raw[at : at + 44])) != checksum:
            raise ValueError(f"{path} is damaged: the block at byte {at} is not what was written")
        if (of_run, of_log, of_layout) != (run, log, layout & 0xFFFF_FFFF):
            raise ValueError(f"{path} is damaged: the block at byte {at} is of another run or another log")
        if first != messages:
            raise ValueError(f"{path} is damaged: the block at byte {at} begins with message {first}, message {messages} is missing")
        steps = max(n - 1, 0)
        begin, end = at + head, at + head + length
        if end > len(raw):
            break  # what a killed writer began
        if zlib.crc32(raw[begin:end]) != body:
            raise ValueError(f"{path} is damaged: the block at byte {at} is not what was written")
        messages += n
        if n == 0:
            at = end
            continue  # the end that its writer gave it
        packed, used, pieces = np.frombuffer(raw[begin:end], np.uint8), 0, []
        for piece in range(0, 13 * words, 128):
            plane, used = _masked(packed, used, min(128, 13 * words - piece))
            pieces.append(plane)
        contents = np.concatenate(pieces)
        present, plain, steady = contents[:words], contents[words : 2 * words], contents[2 * words : 3 * words]
        twins = np.frombuffer(contents[3 * words : 5 * words].tobytes(), "<u2")
        at, rows = end, np.zeros((steps, words), np.uint64)
        for word in range(words):
            if twins[word]:
                rows[:, word] = rows[:, twins[word] - 1]
            for byte in range(8):
                if not present[word] & 1 << byte:
                    continue
                if plain[word] & 1 << byte:
                    plane, used = packed[used : used + steps], used + steps
                else:
                    plane, used = _masked(packed, used, steps, steady[word] & 1 << byte)
                rows[:, word] |= plane.astype(np.uint64) << np.uint64(8 * byte)
        # Zig-zag and differences, undone.
        one, first = np.uint64(1), np.frombuffer(contents[5 * words :].tobytes(), "<u8")
        changes = (rows >> one) ^ (np.uint64(0) - (rows & one))
        blocks.append(np.cumsum(np.vstack([first, changes]), axis=0, dtype=np.uint64))
    whole = np.concatenate(blocks) if blocks else np.zeros((0, words), np.uint64)
    return np.ascontiguousarray(whole).view(dtype).reshape(-1)
