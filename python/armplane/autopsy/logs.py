"""Files to tables of columns: CSV, Parquet, LeRobot folders, MCAP and rosbag2. Each reader raises `LogError` with one sentence where it cannot read on."""

import json
import pathlib
import re
import sqlite3
import struct
from dataclasses import dataclass, field

import numpy as np

# Bytes after which the messages of a topic become arrays, and the largest message that can hold a joint's state.
_PENDING, _LARGEST = 16 << 20, 64 << 10
# Kinds of a layout or messages of one topic, rows of a list, columns of a table: a hostile file could ask for more.
_KINDS, _ROWS, _COLUMNS = 64, 512, 4096
_BASES = {"bool": "u1", "byte": "u1", "char": "u1", "octet": "u1", **{f"{k}{n}": f"{k[0]}{n // 8}" for k in ("int", "uint", "float") for n in (8, 16, 32, 64)}}


KINDS = (".csv", ".tsv", ".txt", ".parquet", ".mcap", ".db3")


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
    """The contents of a log: tables, its robot's URDF where it has one, and sentences about its defects."""

    name: str
    tables: list
    urdf: str | None = None
    notes: list = field(default_factory=list)
    fps: float | None = None


def find(path):
    """The logs at a path: a file, a folder of a bag, run or data set, or a folder of these; `(path, episode)` each."""
    path = pathlib.Path(path)
    if not path.exists():
        raise LogError(f"{path} does not exist: give a log file, or a folder of logs")
    if not path.is_dir():
        return [(path, None)]
    if (path / "messages.mcap").is_file():
        return [(path / "messages.mcap", None)]
    if (path / "meta" / "info.json").is_file():
        return [(path, episode) for episode in range(min(max(_info(path)[0], 1), 10_000))]
    bags = [*path.glob("*.db3"), *path.glob("*.mcap")]
    if (path / "metadata.yaml").is_file() or (bags and len({re.sub(r"_\d+$", "", bag.stem) for bag in bags}) == 1):
        return [(path, None)]
    found = []
    for one in sorted(path.iterdir()):
        if one.suffix.lower() in KINDS or (one.is_dir() and any(any(one.glob(name)) for name in ("*.db3", "*.mcap", "meta/info.json"))):
            found += find(one)
    if not found:
        raise LogError(f"{path} holds no log: give a folder with {', '.join(KINDS)} files, or of a rosbag2 or LeRobot recording")
    return found


def read(path, episode=None):
    """The `Source` at a path that `find` has returned."""
    path = pathlib.Path(path)
    bag = path.is_dir() and not (path / "meta" / "info.json").is_file()
    files = sorted([*path.glob("*.db3"), *path.glob("*.mcap")], key=_number) if bag else [path]
    if bag and not files:
        raise LogError(f"{path} is a rosbag2 folder without a .db3 or .mcap file: give the folder with its data")
    if path.is_file() and path.stat().st_size == 0 or not (path.is_file() or path.is_dir()):
        raise LogError(f"{path} is empty, or no file: was the recording stopped before its first message?")
    if path.is_file() and path.suffix.lower() not in KINDS:
        raise LogError(f"{path} is of no known kind: give a {', '.join(KINDS)} file, or the folder of a rosbag2 or LeRobot recording")
    try:
        if bag or path.suffix.lower() in (".mcap", ".db3"):
            return _bag(path, files)
        return _lerobot(path, episode or 0) if path.is_dir() else _parquet(path) if path.suffix.lower() == ".parquet" else _csv(path)
    except LogError:
        raise
    except ImportError as error:
        raise LogError(f"{path}: {error}: pip install 'armplane[autopsy]'") from None
    except Exception as error:  # Readers of others raise errors of any kind on damaged files.
        raise LogError(f"{path} cannot be read: {_words(error)}; write it again, or cut it where it is damaged") from None


def _words(error):
    return " ".join(str(error).split())[:160] or type(error).__name__


def _number(path):
    match = re.search(r"(\d+)$", path.stem)
    return (int(match.group(1)) if match else -1, path.name)


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
    mark = max(",;\t |", key=lambda one: (min(first.count(one), second.count(one)), -",;\t |".index(one)))
    point = "," if mark == ";" and re.search(r"\d,\d", second) and "." not in second else "."
    broken = []
    named = not all(re.fullmatch(r"\s*[-+.\d][-+.\deE]*\s*", cell) for cell in first.split(mark))
    table = csv.read_csv(
        path,
        csv.ReadOptions(use_threads=False, skip_rows=skip, autogenerate_column_names=not named, block_size=8 << 20),
        csv.ParseOptions(delimiter=mark, invalid_row_handler=lambda row: (broken.append(row.number), "skip")[1]),
        csv.ConvertOptions(null_values=[""], strings_can_be_null=True, decimal_point=point),
    )
    notes = [f"{len(broken)} rows have too few or too many fields, and were left out."] if broken else []
    return Source(path.name, _arrow(path, table), notes=notes)


def _parquet(path, episode=None, names=None):
    from pyarrow import parquet, types

    file = parquet.ParquetFile(path)
    wanted = lambda kind: types.is_floating(kind) or types.is_integer(kind) or types.is_timestamp(kind) or types.is_list(kind) or types.is_fixed_size_list(kind)
    table = file.read([one.name for one in file.schema_arrow if wanted(one.type)][:_COLUMNS], use_threads=False)
    if episode is not None and "episode_index" in table.column_names:
        table = table.filter(np.asarray(table["episode_index"]) == episode)
    return Source(path.name, _arrow(path, table, names))


def _arrow(path, table, names=None):
    """The numbers of an arrow table; columns with empty cells, which were logged less often, become tables by themselves."""
    from pyarrow import compute, types

    groups = {}
    for name in table.column_names[:_COLUMNS]:
        column, parts = table[name].combine_chunks(), {name: table[name].combine_chunks()}
        if types.is_fixed_size_list(column.type) or types.is_list(column.type):
            width = compute.max(compute.list_value_length(column)).as_py() or 0
            if not 0 < width <= 64 or compute.min(compute.list_value_length(column)).as_py() != width:
                continue
            flat, titles = column.flatten(), (names or {}).get(name)
            titles = titles if titles and len(titles) == width else [f"[{k}]" for k in range(width)]
            parts = {f"{name}.{title}" if title[0] != "[" else name + title: flat.take(np.arange(k, len(flat), width)) for k, title in enumerate(titles)}
        for title, part in parts.items():
            if types.is_timestamp(part.type):
                part = compute.divide(part.cast("timestamp[ns]").cast("int64").cast("float64", safe=False), 1e9)
            if not (types.is_floating(part.type) or types.is_integer(part.type)):
                continue
            known = None if part.null_count == 0 else ~np.asarray(part.is_null())
            key = None if known is None else known.tobytes()
            if known is None or known.any():
                groups.setdefault(key, ({}, known))[0][title] = np.asarray(part.to_numpy(zero_copy_only=False), float)
    if not groups:
        raise LogError(f"{path} holds no numbers: give a log with joint positions")
    whole = groups.get(None, ({}, None))[0]
    tables = [Table("", {title: values[known] for title, values in {**whole, **columns}.items()}) for columns, known in groups.values() if known is not None]
    return ([Table("", whole)] if whole else []) + tables


def _info(path):
    try:
        info = json.loads((path / "meta" / "info.json").read_text())
        flat = lambda names: [str(one) for part in names.values() for one in part] if isinstance(names, dict) else [str(one) for one in names or []]
        names = {key: flat(one.get("names")) for key, one in info.get("features", {}).items()}
        return int(info["total_episodes"]), names, float(info.get("fps") or 0)
    except (ValueError, KeyError, AttributeError, TypeError, OSError) as error:
        raise LogError(f"{path}/meta/info.json is not that of a LeRobot data set: {_words(error)}") from None


def _lerobot(path, episode):
    _, names, fps = _info(path)
    files = sorted(path.glob("data/**/*.parquet"))
    for file in [file for file in files if file.stem == f"episode_{episode:06}"] or files:
        source = _parquet(file, episode, names)
        if any(len(values) for table in source.tables for values in table.columns.values()):
            source.name, source.fps = f"{path.name}:{episode}", fps or None
            return source
    raise LogError(f"{path} holds no data of episode {episode}: download its parquet files, too")


class Topic:
    """Collects the messages of a topic, and decodes those of equal layout at once."""

    def __init__(self, topic, kind, types):
        self.topic, self.kind, self.types = topic, kind, types
        self.pending, self.size, self.parts, self.other, self.text = [], 0, {}, 0, None

    def add(self, t_ns, data):
        """One message, logged at `t_ns`."""
        if self.kind.endswith("msg/String") and self.text is None and "description" in self.topic and len(data) < 64 << 20:
            self.text = data[8:].rstrip(b"\0").decode("utf-8", "replace")
        if len(data) > _LARGEST or self.kind not in self.types or not isinstance(data, bytes):
            self.other += 1
            return
        self.pending.append((t_ns, data))
        self.size += len(data)
        if self.size > _PENDING:
            self.flush()

    def flush(self):
        """Decodes what has come in."""
        by_length = {}
        for t_ns, data in self.pending:
            by_length.setdefault(len(data), ([], []))
            by_length[len(data)][0].append(t_ns)
            by_length[len(data)][1].append(data)
        self.pending, self.size = [], 0
        for stamps, blobs in by_length.values():
            block = np.frombuffer(b"".join(blobs), np.uint8).reshape(len(blobs), -1)
            stamps = np.array(stamps, np.int64)
            for _ in range(_KINDS):
                try:
                    leaves, fixed = layout(self.types, self.kind, block[0])
                except (LogError, IndexError, struct.error, ValueError, KeyError, RecursionError):
                    self.other += 1
                    alike = (block == block[0]).all(axis=1)
                else:
                    alike = (block[:, fixed] == block[0, fixed]).all(axis=1)
                    self._keep(leaves, stamps[alike], block[alike])
                block, stamps = block[~alike], stamps[~alike]
                if not len(block):
                    break
            self.other += len(block)

    def _keep(self, leaves, stamps, block):
        cut = lambda offset, dtype: np.ascontiguousarray(block[:, offset : offset + dtype.itemsize]).view(dtype)[:, 0].astype(float)
        columns = {name: cut(offset, dtype) for name, offset, dtype in leaves[:_COLUMNS] if not name.startswith("header.") or ".stamp." in name}
        if columns and (tuple(columns) in self.parts or len(self.parts) < _KINDS):
            self.parts.setdefault(tuple(columns), []).append((stamps, columns))
        else:
            self.other += len(stamps)

    def tables(self):
        """The tables of the topic, one for each layout, in order of time."""
        self.flush()
        for names, parts in self.parts.items():
            stamps = np.concatenate([stamps for stamps, _ in parts])
            order = np.argsort(stamps, kind="stable")
            columns = {name: np.concatenate([columns[name] for _, columns in parts])[order] for name in names}
            yield Table(self.topic, columns, stamps[order] / 1e9, self.kind)


def layout(types, kind, data):
    """The numbers of a CDR message, (name, offset, dtype) each, and a mask of the bytes that all messages of this layout share: lengths and texts."""
    leaves, fixed, position = [], np.zeros(len(data), bool), 4
    order = "<" if data[1] & 1 else ">"
    fixed[:4] = True

    def align(size):
        nonlocal position
        position += -(position - 4) % size

    def count():
        nonlocal position
        align(4)
        (value,) = struct.unpack_from(f"{order}I", data, position)
        fixed[position : position + 4] = True
        position += 4
        if value > len(data):
            raise LogError("a list is longer than its message")
        return value

    def walk(name, node):
        nonlocal position
        form, content = int(node[0]), node[1]
        if form == 1 and content[0] in ("string", "wstring"):
            size = count()
            fixed[position : position + size] = True
            text = bytes(data[position : position + max(size - 1, 0)]).decode("utf-8", "replace")
            position += size
            return text
        if form == 1:
            dtype = np.dtype(order + _BASES[content[0]])
            align(dtype.itemsize)
            if position + dtype.itemsize > len(data):
                raise LogError("a message ends early")
            leaves.append((name, position, dtype))
            position += dtype.itemsize
            return None
        if form == 2:
            fields = types[content][1]
            texts = {field: walk(f"{name}.{field}" if name else field, one) for field, one in fields}
            _rename(leaves, name, texts)
            return texts
        size = content[1] if form == 3 else count()
        if size > _ROWS:
            raise LogError("a list too long for joints")
        return [walk(f"{name}[{k}]", content[0]) for k in range(size)]

    walk("", (2, kind))
    return leaves, fixed


def _rename(leaves, prefix, texts):
    """Names the elements of a message's lists by the names that the same message gives."""
    names = next((texts[key] for key in ("name", "joint_names", "names", "joints") if isinstance(texts.get(key), list) and texts[key]), None)
    if names and all(isinstance(one, str) for one in names):
        start = f"{prefix}." if prefix else ""
        for k, (name, offset, dtype) in enumerate(leaves):
            match = re.fullmatch(re.escape(start) + r"(.*)\[(\d+)\]", name)
            if match and int(match.group(2)) < len(names):
                leaves[k] = (f"{start}{match.group(1)}.{names[int(match.group(2))]}", offset, dtype)


def _types(texts):
    """Type definitions by name: those that the log states before those of ROS 2."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    types = dict(get_typestore(Stores.LATEST).fielddefs)
    for name, encoding, text in texts:
        try:
            types.update((get_types_from_idl(text) if "idl" in encoding else get_types_from_msg(text, name)) if text.strip() else {})
        except Exception:  # A definition that cannot be parsed leaves its topic undecoded, which the notes say.
            continue
    return types


def _bag(path, files):
    topics, notes = {}, []
    for file in files:
        (_sqlite if file.suffix == ".db3" else _mcap)(file, topics, notes)
    source = Source(path.parent.name if path.name == "messages.mcap" else path.name, [], notes=notes)
    for topic in topics.values():
        source.tables += topic.tables()
        source.urdf = source.urdf or topic.text
    if other := sorted(topic.topic for topic in topics.values() if topic.other and not topic.parts and not topic.text):
        source.notes.append(f"Not decoded: {', '.join(other[:5])}{f' and {len(other) - 5} more' if len(other) > 5 else ''}.")
    if not source.tables:
        raise LogError(f"{path} holds no message with numbers: record /joint_states, too")
    return source


def _sqlite(path, topics, notes):
    """The messages of a .db3 file, by Python's own reader, which needs no metadata.yaml and reads what a crash has left."""
    with sqlite3.connect(f"file:{str(path).replace('?', '%3f').replace('#', '%23')}?mode=ro&immutable=1", uri=True) as base:
        rows = base.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
        try:
            texts = base.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions").fetchall()
        except sqlite3.Error:
            texts = []
        types = _types(texts)
        for key, name, kind, form in rows:
            if form == "cdr":
                topic = topics.setdefault(name, Topic(name, kind, types))
                try:
                    for t_ns, data in base.execute("SELECT timestamp, data FROM messages WHERE topic_id = ? AND length(data) < ?", (key, 64 << 20)):
                        topic.add(t_ns, data)
                except sqlite3.Error as error:
                    notes.append(f"{path.name} is damaged ({_words(error)}); it was read up to there.")
    base.close()


def _mcap(path, topics, notes):
    from mcap.exceptions import McapError
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import StreamReader, get_chunk_data_stream

    schemas, channels = {}, {}

    def take(record):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in channels:
            schema = schemas.get(record.schema_id)
            known = schema is not None and record.message_encoding == "cdr"
            types = _types([(schema.name, schema.encoding, schema.data.decode("utf-8", "replace"))]) if known else {}
            name = schema.name if schema else ""
            channels[record.id] = topics.setdefault(record.topic, Topic(record.topic, name, types))
        elif isinstance(record, Message) and record.channel_id in channels:
            channels[record.channel_id].add(record.log_time, record.data)

    try:
        with open(path, "rb") as file:
            for record in StreamReader(file, emit_chunks=True, record_size_limit=1 << 30).records:
                if isinstance(record, Chunk):
                    if record.uncompressed_size > 1 << 30:
                        raise LogError("a chunk of more than 1 GB")
                    stream, size = get_chunk_data_stream(record)
                    _chunk(stream.read(size), take, channels)
                else:
                    take(record)
    except (McapError, EOFError, struct.error, RuntimeError, ValueError, AttributeError, UnicodeDecodeError, OSError) as error:
        if not any(topic.pending or topic.parts for topic in topics.values()):
            raise LogError(f"{path} is no MCAP file, or damaged from the start ({_words(error)}): give another recording") from None
        notes.append(f"{path.name} ends early or is damaged ({_words(error)}); it was read up to there.")


def _chunk(data, take, channels):
    """The records of a chunk: messages by their first bytes, which is all that costs time; the others by the library."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Schema

    import io

    head, place = struct.Struct("<BQHIQQ"), 0
    while place + 9 <= len(data):
        kind, size = data[place], int.from_bytes(data[place + 1 : place + 9], "little")
        end = place + 9 + size
        if end > len(data):
            raise ValueError("a record ends beyond its chunk")
        if kind == 5 and size >= 22:
            _, _, channel, _, log_time, _ = head.unpack_from(data, place)
            if channel in channels:
                channels[channel].add(log_time, data[place + 31 : end])
        elif kind in (3, 4):
            take((Schema if kind == 3 else Channel).read(ReadDataStream(io.BytesIO(data[place + 9 : end]))))
        place = end
