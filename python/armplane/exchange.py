"""A program's side of the exchange page, by the standard library alone. docs/wire.md describes the page."""

import ctypes
import errno
import json
import mmap
import os
import platform

from . import wire

_LIBC = ctypes.CDLL(None, use_errno=True)
# The kernel's number of futex(2).
_FUTEX = {"x86_64": 202, "aarch64": 98}.get(platform.machine())
_WAIT, _WAKE = 0, 1


class _Timespec(ctypes.Structure):
    _fields_ = [("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long)]


_HALF_A_SECOND = _Timespec(0, 500_000_000)


class WireError(Exception):
    """The page or its topics do not fit this package."""


def _words():
    """Loads and stores in the order that the page demands: plain ones if the processor keeps that order, otherwise libatomic's."""
    if platform.machine() == "x86_64":
        # Stores leave this processor in order and loads are not taken before earlier loads; an aligned word is one access in ctypes.
        return (lambda word: word.value), (lambda word, value: setattr(word, "value", value))
    try:
        atomic = ctypes.CDLL("libatomic.so.1")
    except OSError as error:
        raise WireError(f"this processor needs libatomic.so.1 for an exchange page: {error}") from None
    load, store = atomic.__atomic_load_4, atomic.__atomic_store_4
    load.restype = ctypes.c_uint32
    acquire, release = 2, 3
    return (lambda word: load(ctypes.byref(word), acquire)), (lambda word, value: store(ctypes.byref(word), ctypes.c_uint32(value), release))


def _put(field, text):
    field[:] = [0] * len(field)
    raw = text.encode()[: len(field) - 1].decode(errors="ignore").encode()
    field[: len(raw)] = raw


def _text(field):
    return bytes(field).split(b"\0", 1)[0].decode(errors="replace")


class Topic:
    """One topic of the page: its message in shared memory, and whether it belongs to the current request."""

    def __init__(self, entry, message):
        self._entry = entry
        self.name = _text(entry.name)
        self.usage = entry.usage
        self.message = message

    @property
    def fresh(self):
        return self._entry.fresh != 0


class Exchange:
    """The page of this program, mapped.

    `topics` maps names to `Topic`; a topic's `message` is a `ctypes` structure that lies in shared memory: nothing is copied.
    """

    def __init__(self, path=None):
        path = path or os.environ.get("ARMPLANE_EXCHANGE")
        if not path:
            raise WireError("ARMPLANE_EXCHANGE is not set: armplane starts this program, `armplane run SCENARIO --graph FILE.toml`")
        if _FUTEX is None:
            raise WireError(f"the number of the system call futex on {platform.machine()} is not known to this package")
        with open(path, "r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)
        self.path = path
        head = wire.ExchangeHead.from_buffer(self._map)
        if head.mark != wire.EXCHANGE_MARK or head.bytes != len(self._map):
            raise WireError(f"{path} is no exchange page")
        self.head = head
        self._load, self._store = _words()
        self._requests, self._answers, self._program = (self._word(name) for name in ("requests", "answers", "program"))
        self._requests_at = ctypes.addressof(self._requests)
        self._answers_at = ctypes.addressof(self._answers)
        self._seen = 0
        head.program_version = wire.EXCHANGE_VERSION
        if head.version != wire.EXCHANGE_VERSION:
            # Of another version only the first fields are known.
            self._store(self._program, wire.PROGRAM_REFUSED)
            raise WireError(f"armplane speaks version {head.version} of the exchange page, this package version {wire.EXCHANGE_VERSION}")
        head.program_pid = os.getpid()
        self.topics = {}
        for i in range(head.topics):
            entry = wire.ExchangeTopic.from_buffer(self._map, head.topics_at + i * ctypes.sizeof(wire.ExchangeTopic))
            name = _text(entry.name)
            if name not in wire.TOPICS:
                continue
            structure, type_name, layout = wire.TOPICS[name]
            _put(entry.program_type, type_name)
            entry.program_layout = layout
            if layout != entry.layout:
                # armplane refuses it, with both names; the message must not be looked at with the wrong structure.
                continue
            self.topics[name] = Topic(entry, structure.from_buffer(self._map, entry.at))

    def _word(self, name):
        return ctypes.c_uint32.from_buffer(self._map, getattr(wire.ExchangeHead, name).offset)

    def refuse(self, why):
        """Tells armplane that this program cannot take part, and raises the reason."""
        _put(self.head.complaint, why)
        self._store(self._program, wire.PROGRAM_REFUSED)
        raise WireError(why)

    def ready(self):
        """Tells armplane that the program waits for requests."""
        self._store(self._program, wire.PROGRAM_JOINED)

    def next(self):
        """Waits for the next request and returns its code, which is `REQUEST_STOP` if armplane is gone."""
        while True:
            requests = self._load(self._requests)
            if requests != self._seen:
                self._seen = requests
                return self.head.request
            wait = _LIBC.syscall(_FUTEX, ctypes.c_void_p(self._requests_at), _WAIT, requests, ctypes.byref(_HALF_A_SECOND), None, 0)
            if wait == -1 and ctypes.get_errno() == errno.ETIMEDOUT:
                try:
                    os.kill(self.head.armplane_pid, 0)
                except ProcessLookupError:
                    _put(self.head.reason, "armplane is gone")
                    return wire.REQUEST_STOP

    def answer(self, code=wire.ANSWER_DONE):
        """Answers the current request."""
        self.head.answer_tick = self.head.tick
        self.head.answer = code
        self._store(self._answers, self._seen)
        _LIBC.syscall(_FUTEX, ctypes.c_void_p(self._answers_at), _WAKE, 1, None, None, 0)

    def fail(self, why):
        """Tells armplane that the program cannot continue, and why."""
        _put(self.head.complaint, why)
        self.answer(wire.ANSWER_FAILED)

    @property
    def reason(self):
        """Why armplane stops the program; empty at the ordinary end of a run."""
        return _text(self.head.reason)

    @property
    def state(self):
        """The checkpoint that a predecessor left, or `None`."""
        left, at = self.head.state_left, self.head.state_at
        return bytes(self._map[at : at + left]) if left else None

    @state.setter
    def state(self, state):
        if len(state) > self.head.state_room:
            raise ValueError(f"a checkpoint of {len(state)} bytes; there is room for {self.head.state_room}")
        at = self.head.state_at
        self._map[at : at + len(state)] = state
        self.head.state_bytes = len(state)

    def job(self):
        """The job of the run: scenario, robot and graph, as in the run's job.json."""
        with open(os.path.join(os.path.dirname(self.path), "job.json")) as file:
            return json.load(file)

    def arm(self):
        """The arm of the run in MJCF, in base axes. The site `end_effector` is the end-effector, a key the start, a joint's `user` its speed limit."""
        with open(os.path.join(os.path.dirname(self.path), "arm.xml")) as file:
            return file.read()
