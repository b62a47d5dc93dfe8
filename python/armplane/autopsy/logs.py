"""Files to tables of columns: CSV, Parquet, LeRobot folders, MCAP and rosbag2. Each reader raises `LogError` with one sentence where it cannot read on."""

from __future__ import annotations

import contextlib
import json
import pathlib
import re
import sqlite3
import struct
from dataclasses import dataclass, field

import numpy as np

from ..results import INSTALL

KINDS = (".csv", ".tsv", ".txt", ".parquet", ".mcap", ".db3")
# Bytes after which the messages of a topic become arrays, and the largest message that can hold a joint's state or a robot's description.
_PENDING, _LARGEST, _DESCRIPTION = 16 << 20, 64 << 10, 64 << 20
# Layouts of one topic's messages, rows of a list, columns of a table: a hostile file could ask for more.
_LAYOUTS, _ROWS, _COLUMNS = 64, 512, 4096
# Lists of a message that name the elements of its other lists.
_NAMES = ("name", "joint_names", "names", "joints")
_LEROBOT = "meta/info.json"


class LogError(ValueError):
    """A log that cannot be read, with the reason and the remedy."""


@dataclass
class Table:
    """Columns of one length with their time stamps `t` (s; `None` where a column holds them). `topic` is empty for a file of columns."""

    topic: str
    columns: dict
    t: np.ndarray | None = None
    kind: str = ""


@dataclass
class Source:
    """The contents of a log: tables, its robot's URDF, of a run also the arm's description, joints and tip, and sentences about defects."""

    name: str
    tables: list
    urdf: str | None = None
    description: str = ""
    dof: int | None = None
    tip: str | None = None
    notes: list = field(default_factory=list)
    fps: float | None = None


def find(path):
    """The logs at a path: a file, a folder of a bag, run or data set, or a folder of these; `(path, episode)` each."""
    path = pathlib.Path(path)
    if not path.exists():
        raise LogError(f"{path} does not exist: give a log file, or a folder of logs")
    if (path / "messages.mcap").is_file():
        return [(path / "messages.mcap", None)]
    if (path / _LEROBOT).is_file():
        return [(path, episode) for episode in range(min(max(_info(path)["total_episodes"], 1), 10_000))]
    if not path.is_dir() or (path / "metadata.yaml").is_file() or len({re.sub(r"_\d+$", "", bag.stem) for bag in _bags(path)}) == 1:
        return [(path, None)]
    inside = [one for one in sorted(path.iterdir()) if one.suffix.lower() in KINDS or _bags(one) or (one / _LEROBOT).is_file()]
    if not inside:
        raise LogError(f"{path} holds no log: give a folder with {', '.join(KINDS)} files, or of a rosbag2 or LeRobot recording")
    return [log for one in inside for log in find(one)]


def _bags(path):
    """The parts of a rosbag2 folder in their order."""
    number = lambda part: int(found[1]) if (found := re.search(r"(\d+)$", part.stem)) else -1
    return sorted([*path.glob("*.db3"), *path.glob("*.mcap")], key=lambda part: (number(part), part.name))


def read(path, episode=None):
    """The `Source` at a path that `find` has returned."""
    path = pathlib.Path(path)
    is_set, kind = (path / _LEROBOT).is_file(), path.suffix.lower()
    files = _bags(path) if path.is_dir() else [path]
    if not is_set and not files:
        raise LogError(f"{path} is a rosbag2 folder without a .db3 or .mcap file: give the folder with its data")
    if not path.is_dir() and (not path.is_file() or path.stat().st_size == 0):
        raise LogError(f"{path} is empty, or no file: was the recording stopped before its first message?")
    if path.is_file() and kind not in KINDS:
        raise LogError(f"{path} is of no known kind: give a {', '.join(KINDS)} file, or the folder of a rosbag2 or LeRobot recording")
    try:
        if is_set:
            return _lerobot(path, episode or 0)
        if path.is_dir() or kind in (".mcap", ".db3"):
            return _bag(path, files)
        return _parquet(path) if kind == ".parquet" else _csv(path)
    except LogError:
        raise
    except ImportError as error:
        raise LogError(f"{path}: {error}: {INSTALL.format('autopsy')}") from None
    except Exception as error:  # Readers of others raise errors of any kind on damaged files.
        raise LogError(f"{path} cannot be read: {_words(error)}; write it again, or cut it where it is damaged") from None


def _words(error):
    return " ".join(str(error).split())[:160] or type(error).__name__


def _csv(path):
    from pyarrow import csv

    with open(path, "rb") as file:
        head = file.read(1 << 16)
    if b"\0" in head:
        raise LogError(f"{path} holds binary data, not text: give it the name of its kind, such as .mcap or .parquet")
    lines = [line for line in head.decode("utf-8", "replace").splitlines() if line.strip()]
    # Comments above the header, as loggers of makers write them.
    skip = next((k for k, line in enumerate(lines[:50]) if not line.startswith(("#", "%", "//"))), 0)
    if len(lines) < skip + 2:
        raise LogError(f"{path} has no row of numbers: give a table with a header")
    first, second = lines[skip], lines[skip + 1]
    mark = max(",;\t |", key=lambda one: min(first.count(one), second.count(one)))
    is_named = not all(re.fullmatch(r"\s*[-+.\d][-+.\deE]*\s*", cell) for cell in first.split(mark))
    point = "," if mark == ";" and re.search(r"\d,\d", second) and "." not in second else "."
    broken = []
    how = csv.ReadOptions(use_threads=False, skip_rows=skip, autogenerate_column_names=not is_named, block_size=8 << 20)
    form = csv.ParseOptions(delimiter=mark, invalid_row_handler=lambda row: broken.append(row) or "skip")
    table = csv.read_csv(path, how, form, csv.ConvertOptions(null_values=[""], strings_can_be_null=True, decimal_point=point))
    notes = [f"{len(broken)} rows have too few or too many fields, and were left out."] if broken else []
    return Source(path.name, _tables(path, table), notes=notes)


def _parquet(path, episode=None, names=None):
    from pyarrow import compute, parquet, types

    file = parquet.ParquetFile(path)
    # Not the pictures of a data set.
    known = [one.name for one in file.schema_arrow if not (types.is_struct(one.type) or types.is_binary(one.type) or types.is_large_binary(one.type))]
    table = file.read(known[:_COLUMNS], use_threads=False)
    if episode is not None and "episode_index" in table.column_names:
        table = table.filter(compute.equal(table["episode_index"], episode))
    return Source(path.name, _tables(path, table, names))


def _tables(path, table, names=None):
    """The numbers of an arrow table; columns with empty cells, which were logged less often, become tables by themselves."""
    groups, alike = {}, {}
    for name in table.column_names[:_COLUMNS]:
        for title, values, known in _numbers(name, table[name].combine_chunks(), (names or {}).get(name)):
            if known.any():
                alike.setdefault(re.sub(r"\d+", "#", title), []).append((title, values, known))
    for columns in alike.values():
        rows = _logged(np.any([known for *_, known in columns], axis=0))
        for title, values, known in columns:
            groups.setdefault(rows.tobytes(), ({}, rows))[0][title] = np.where(known, values, np.nan)
    if not groups:
        raise LogError(f"{path} holds no numbers: give a log with joint positions")
    whole = groups.pop(np.ones(len(table), bool).tobytes(), ({},))[0]
    parts = [Table("", {title: values[known] for title, values in {**whole, **columns}.items()}) for columns, known in groups.values()]
    return ([Table("", whole)] if whole else []) + parts


def _logged(known):
    """The rows in which columns alike were logged: also a few stretches of empty cells inside, as pandas writes a NaN, which it calls missing."""
    first, last = np.flatnonzero(known)[[0, -1]]
    inside = known[first : last + 1]
    if not 0 < np.count_nonzero(np.diff(inside.astype(np.int8)) < 0) <= 3:
        return known
    rows = known.copy()
    rows[first : last + 1] = True
    return rows


def _numbers(name, column, titles):
    """A column, or the columns of a list, as floats with a mask of the cells that are there; time stamps in seconds."""
    from pyarrow import types

    if types.is_list(column.type) or types.is_fixed_size_list(column.type):
        flat = column.flatten()
        width = len(flat) // max(len(column), 1)
        is_even = np.all(np.asarray(column.value_lengths()) == width) if types.is_list(column.type) else not column.null_count
        if is_even and 0 < width <= 64 and (types.is_floating(flat.type) or types.is_integer(flat.type)):
            rows = flat.to_numpy(zero_copy_only=False).astype(float).reshape(-1, width)
            titles = [f".{title}" for title in titles or ()] if len(titles or ()) == width else [f"[{k}]" for k in range(width)]
            yield from ((name + title, rows[:, k], np.ones(len(rows), bool)) for k, title in enumerate(titles))
    elif types.is_timestamp(column.type):
        yield name, column.cast("timestamp[ns]").cast("int64").to_numpy(zero_copy_only=False) / 1e9, np.asarray(column.is_valid())
    elif types.is_floating(column.type) or types.is_integer(column.type):
        yield name, column.to_numpy(zero_copy_only=False).astype(float, copy=False), np.asarray(column.is_valid())


def _info(path):
    """`meta/info.json` of a LeRobot data set, with the names of each feature's elements as a list."""
    try:
        info = json.loads((path / _LEROBOT).read_text())
        info["total_episodes"] = int(info["total_episodes"])
        flat = lambda names: [str(one) for part in names.values() for one in part] if isinstance(names, dict) else list(map(str, names or ()))
        info["names"] = {key: flat(one.get("names")) for key, one in info.get("features", {}).items()}
        return info
    except (ValueError, KeyError, AttributeError, TypeError, OSError) as error:
        raise LogError(f"{path}/{_LEROBOT} is not that of a LeRobot data set: {_words(error)}") from None


def _lerobot(path, episode):
    info, files = _info(path), sorted(path.glob("data/**/*.parquet"))
    for file in [file for file in files if file.stem == f"episode_{episode:06}"] or files:
        source = _parquet(file, episode, info["names"])
        if any(len(values) for table in source.tables for values in table.columns.values()):
            source.name, source.fps = f"{path.name}:{episode}", float(info.get("fps") or 0) or None
            return source
    raise LogError(f"{path} holds no data of episode {episode}: download its parquet files, too")


class Topic:
    """Collects the messages of a topic, and decodes those of equal layout at once."""

    def __init__(self, name, kind, types):
        self.name, self.kind, self.types = name, kind, types
        self.waiting, self.size, self.parts, self.is_partial, self.text = {}, 0, {}, False, None

    def add(self, t_ns, data):
        """One message, logged at `t_ns`."""
        if self.kind.endswith("msg/String") and "description" in self.name:
            self.text = self.text or data[8:].rstrip(b"\0").decode("utf-8", "replace")
        elif len(data) > _LARGEST or self.kind not in self.types:
            self.is_partial = True
        else:
            self.waiting.setdefault(len(data), []).append((t_ns, data))
            self.size += len(data)
            if self.size > _PENDING:
                self.decode()

    def decode(self):
        """Turns what has come in into columns."""
        for messages in self.waiting.values():
            block = np.frombuffer(b"".join(data for _, data in messages), np.uint8).reshape(len(messages), -1)
            stamps = np.array([t_ns for t_ns, _ in messages])
            for _ in range(_LAYOUTS):
                try:
                    leaves, fixed = layout(self.types, self.kind, block[0])
                except (IndexError, struct.error, ValueError, KeyError, RecursionError):
                    leaves, fixed, self.is_partial = [], np.ones(block.shape[1], bool), True
                alike = (block[:, fixed] == block[0, fixed]).all(axis=1)
                self._keep(leaves, stamps[alike], block[alike])
                block, stamps = block[~alike], stamps[~alike]
                if not len(block):
                    break
        self.waiting, self.size = {}, 0

    def _keep(self, leaves, stamps, block):
        cut = lambda offset, dtype: np.ascontiguousarray(block[:, offset : offset + dtype.itemsize]).view(dtype)[:, 0].astype(float)
        columns = {name: cut(offset, dtype) for name, offset, dtype in leaves[:_COLUMNS] if not name.startswith("header.") or ".stamp." in name}
        if columns and (tuple(columns) in self.parts or len(self.parts) < _LAYOUTS):
            self.parts.setdefault(tuple(columns), []).append((stamps, columns))

    def tables(self):
        """The tables of the topic, one for each layout, in order of time."""
        self.decode()
        for names, parts in self.parts.items():
            stamps = np.concatenate([stamps for stamps, _ in parts])
            order = np.argsort(stamps, kind="stable")
            columns = {name: np.concatenate([columns[name] for _, columns in parts])[order] for name in names}
            yield Table(self.name, columns, stamps[order] / 1e9, self.kind)


def layout(types, kind, data):
    """The numbers of a CDR message, (name, offset, dtype) each, and a mask of the bytes that all messages of this layout share: lengths and texts."""
    leaves, fixed, end, order = [], np.zeros(len(data), bool), 4, "<" if data[1] & 1 else ">"
    fixed[:4] = True

    def take(form):
        """The place of the next number."""
        nonlocal end
        dtype = np.dtype(order + form)
        start = end + -(end - 4) % dtype.itemsize
        end = start + dtype.itemsize
        if end > len(data):
            raise LogError("a message ends early")
        return start, dtype

    def count():
        start, dtype = take("u4")
        fixed[start:end] = True
        return int(data[start:end].view(dtype)[0])

    def walk(name, node):
        """Adds the numbers of a field; returns its text, or those in it by field or in order."""
        nonlocal end
        form, content = int(node[0]), node[1]
        if form == 1 and "string" in content[0]:
            size = count()
            fixed[end : end + size] = True
            end += size
            return bytes(data[end - size : end]).rstrip(b"\0").decode("utf-8", "replace")
        if form == 1:
            kind, bits = content[0], re.sub(r"\D", "", content[0])
            leaves.append((name, *take(f"{kind[0]}{int(bits) // 8}" if bits else "u1")))
            return None
        if form == 2:
            first, prefix = len(leaves), f"{name}." if name else ""
            texts = {inner: walk(prefix + inner, one) for inner, one in types[content][1]}
            names = next((texts[key] for key in _NAMES if isinstance(texts.get(key), list) and isinstance([*texts[key], None][0], str)), ())
            named = lambda match: f".{names[int(match[1])]}" if int(match[1]) < len(names) else match[0]
            leaves[first:] = [(re.sub(r"\[(\d+)\]$", named, leaf), *place) for leaf, *place in leaves[first:]]
            return texts
        size = content[1] if form == 3 else count()
        if size > _ROWS:
            raise LogError("a list too long for joints")
        return [walk(f"{name}[{k}]", content[0]) for k in range(size)]

    walk("", (2, kind))
    return leaves, fixed


def _types(texts):
    """Type definitions by name: those that the log states before those of ROS 2."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    types = dict(get_typestore(Stores.LATEST).fielddefs)
    for name, encoding, text in texts:
        # A definition that cannot be parsed leaves its topic undecoded, which the notes say.
        with contextlib.suppress(Exception):
            types |= (get_types_from_idl(text) if "idl" in encoding else get_types_from_msg(text, name)) if text.strip() else {}
    return types


def _bag(path, files):
    topics, notes, job = {}, [], b""
    for file in files:
        try:
            for name, kind, types, t_ns, data in (_sqlite if file.suffix == ".db3" else _mcap)(file):
                if types is None:
                    job = data
                    continue
                if name not in topics:
                    topics[name] = Topic(name, kind, types)
                topics[name].add(t_ns, data)
        except MemoryError:
            raise
        except Exception as error:  # Of the reader, on a damaged file.
            if not any(topic.waiting or topic.parts for topic in topics.values()):
                raise LogError(f"{file} is damaged from the start ({_words(error)}): give another recording") from None
            notes.append(f"{file.name} ends early or is damaged ({_words(error)}); it was read up to there.")
    source = Source(path.parent.name if path.name == "messages.mcap" else path.name, [], notes=notes)
    source.tables = [table for topic in topics.values() for table in topic.tables()]
    source.urdf = next((topic.text for topic in topics.values() if topic.text), None)
    with contextlib.suppress(ValueError, KeyError, TypeError):  # Another program's job.json has other keys.
        job = json.loads(job)
        source.description, source.dof, source.tip = str(job["robot"]["description"]), int(job["dof"]), job["scenario"]["frame"] or None
    if other := sorted(topic.name for topic in topics.values() if topic.is_partial and not topic.parts):
        source.notes.append(f"Not decoded: {', '.join(other[:5])}{f' and {len(other) - 5} more' if len(other) > 5 else ''}.")
    if not source.tables:
        raise LogError(f"{path} holds no message with numbers: record /joint_states, too")
    return source


def _sqlite(path):
    """The messages of a .db3 file, by Python's own reader, which needs no metadata.yaml and reads what a crash has left."""
    name = str(path).replace("?", "%3f").replace("#", "%23")
    with contextlib.closing(sqlite3.connect(f"file:{name}?mode=ro&immutable=1", uri=True)) as base:
        try:
            types = _types(base.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions").fetchall())
        except sqlite3.OperationalError:  # An older version of rosbag2.
            types = _types(())
        question = """SELECT name, type, timestamp, data FROM messages JOIN topics ON topics.id = topic_id
                      WHERE serialization_format = 'cdr' AND length(data) < ?"""
        for name, kind, t_ns, data in base.execute(question, (_DESCRIPTION,)):
            yield name, kind, types, t_ns, data


def _mcap(path):
    """The messages of an MCAP file, and the job.json that runs of armplane attach: without types."""
    from mcap.records import Attachment, Channel, Message, Schema
    from mcap.stream_reader import StreamReader

    schemas, channels = {}, {}
    with open(path, "rb") as file:
        for record in StreamReader(file, record_size_limit=1 << 30).records:
            if isinstance(record, Message):
                yield *channels[record.channel_id], record.log_time, record.data
            elif isinstance(record, Schema):
                schemas[record.id] = record.name, record.encoding, record.data.decode("utf-8", "replace")
            elif isinstance(record, Attachment) and record.name == "job.json":
                yield record.name, "", None, 0, record.data
            elif isinstance(record, Channel) and record.id not in channels:
                schema, is_cdr = schemas.get(record.schema_id, ("", "", "")), record.message_encoding == "cdr"
                channels[record.id] = record.topic, schema[0], _types([schema]) if is_cdr else {}
