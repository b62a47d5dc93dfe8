"""A process of a run, by `libarmplane-process`: what `armplane.Process` is built on."""

import ctypes
import functools
import json
import os
from pathlib import Path
import threading

from . import wire
from .results import _program

_ABI = 1
_TICK, _LOOKED = 1, -2
_HERE = Path(__file__).parent


class ProcessError(Exception):
    """A program cannot take part in its run, or no longer."""


class _Now(ctypes.Structure):
    _fields_ = [("tick", ctypes.c_uint64), ("fresh", ctypes.c_uint64)]
    _fields_ += [(name, ctypes.c_uint32) for name in ("lockstep", "rate_hz", "dof", "incarnation", "keeps", "reserved")]


class _Topic(ctypes.Structure):
    _fields_ = [("name", ctypes.c_char_p), ("type_name", ctypes.c_char_p), ("layout", ctypes.c_uint64), ("bytes", ctypes.c_uint64)]
    _fields_ += [("is_output", ctypes.c_uint32), ("reserved", ctypes.c_uint32)]


_Look = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)
_KINDS = {
    "void": None, "int": ctypes.c_int32, "u32": ctypes.c_uint32, "u64": ctypes.c_uint64, "size": ctypes.c_size_t, "text": ctypes.c_char_p,
    "void*": ctypes.c_void_p, "size*": ctypes.POINTER(ctypes.c_size_t), "now*": ctypes.POINTER(_Now), "topic*": ctypes.POINTER(_Topic), "look": _Look,
}  # fmt: skip
# Of each function: its name, what it returns, and its arguments; of all but `join`, a handle comes first.
_FUNCTIONS = """
join: void* u32 text text text size
about: now* void*
topic_at: topic* void* size
folder: text void*
input: void* void* text u64
copy: void* void* text u64
output: void* void* text u64
wait: int void*
send: int void* int
keep: int void* text size
previous: void* void* size*
look_out: void void* look void*
fail: int void* text
error: text void*
leave: int void*
"""


@functools.cache
def _library():
    """The library of the program `armplane` that has started this one, or of the wheel. Its calls release Python's lock."""
    program = Path(_program()).parent
    built = [program / part / "libarmplane_process.so" for part in ("", "deps")]
    places = [*built, _HERE / "libarmplane-process.so", program.parent / "lib/libarmplane-process.so"]
    place = next((place for place in places if place.is_file()), None)
    if place is None:
        raise ProcessError(f"libarmplane-process is in none of {', '.join(str(place.parent) for place in places)}: install the wheel that `python/build` makes")
    library = ctypes.CDLL(str(place))
    for name, kinds in (line.split(": ") for line in _FUNCTIONS.strip().splitlines()):
        function = getattr(library, f"armplane_process_{name}")
        function.restype, *function.argtypes = (_KINDS[kind] for kind in kinds.split())
    return library


def _declared(topic):
    """The message of a topic that only the graph knows."""
    kinds = {"f64": ctypes.c_double, "u64": ctypes.c_uint64, "u32": ctypes.c_uint32, "Header": wire.Header}
    fields = []
    for field in topic["fields"]:
        name, kind = (part.strip() for part in field.split(":"))
        element, _, count = kind.strip("[]").partition(";")
        kind = kinds[element.strip()] * int(count) if count else kinds[element.strip()]
        fields.append((name, kind))
    return type(topic["type"].split(".")[1], (ctypes.Structure,), {"_fields_": fields})


class Joined:
    """A process of the run that has started this program, or of the run in a folder.

    `inputs` and `outputs` map topics to messages, `ctypes` structures. An input is a copy that the next message overwrites; `view` gives it without one.
    """

    def __init__(self, run=None, name=None):
        self._library, why = _library(), ctypes.create_string_buffer(1024)
        run, name = (text and os.fsencode(text) for text in (run, name))
        self._handle = self._library.armplane_process_join(_ABI, run, name, why, len(why))
        if not self._handle:
            raise ProcessError(why.value.decode(errors="replace"))
        self._wait, self._send = self._library.armplane_process_wait, self._library.armplane_process_send
        self.now = self._call("about").contents
        self.folder, self._raised = os.fsdecode(self._call("folder")), None
        # Signals are the main thread's; and another one, if it called Python while that ends, would take the process down.
        if threading.current_thread() is threading.main_thread():
            looks = self._looks()
            next(looks)
            # Kept: the library calls it.
            self._look = _Look(looks.send)
            self._call("look_out", self._look, None)
        self.job = json.loads(Path(self.folder, "job.json").read_text())
        declared = {topic["name"]: topic for topic in self.job["graph"].get("topic", ())}
        self.inputs, self.outputs, self._inputs = {}, {}, {}
        while described := self._call("topic_at", len(self.inputs) + len(self.outputs)):
            topic = described.contents
            name = topic.name.decode()
            structure, _, layout = wire.TOPICS[name] if name in wire.TOPICS else (_declared(declared[name]), None, topic.layout)
            place = self._call("output" if topic.is_output else "copy", topic.name, layout)
            if not place:
                why = self.error
                self.leave()
                raise ProcessError(why)
            (self.outputs if topic.is_output else self.inputs)[name] = structure.from_address(place)
            if not topic.is_output:
                self._inputs[name] = structure, layout, 1 << len(self._inputs)

    def _call(self, name, *arguments):
        return getattr(self._library, f"armplane_process_{name}")(self._handle, *arguments)

    def _looks(self):
        # The library goes on with it while it waits. Handlers of signals run as soon as it does: a function would be entered outside of its `try`.
        ends = 0
        while True:
            try:
                yield ends
                ends = 0
                ctypes.pythonapi.PyErr_CheckSignals()
            except GeneratorExit:
                return
            except BaseException as raised:
                self._raised, ends = raised, 1

    def wait(self):
        """Waits for the next tick, without Python's lock; false when the run is over for this process."""
        status = self._wait(self._handle)
        if status < 0:
            raise self._raised if status == _LOOKED and self._raised else ProcessError(self.error)
        return status == _TICK

    def send(self, last=False):
        """Answers the tick in hand with the outputs. `last`, of the process that makes the ticks: the run ends with this tick."""
        if self._send(self._handle, bool(last)):
            raise ProcessError(self.error)

    def is_fresh(self, topic):
        """Whether a message of a topic has come for the tick in hand."""
        return bool(self.now.fresh & self._inputs[topic][2])

    def view(self, topic):
        """The message of the tick in hand in shared memory, valid until the next wait; `None` if none has come."""
        structure, layout, _ = self._inputs[topic]
        place = self._call("input", topic.encode(), layout)
        return structure.from_address(place) if place else None

    def keep(self, state):
        """Gives the state after the tick in hand, before it is sent."""
        self._call("keep", bytes(state), len(state))

    @property
    def previous(self):
        """The state that a predecessor has left, or `None`."""
        size = ctypes.c_size_t()
        place = self._call("previous", ctypes.byref(size))
        return ctypes.string_at(place, size.value) if place else None

    @property
    def error(self):
        """Why the process cannot go on; empty where it can."""
        return self._call("error").decode(errors="replace")

    def fail(self, why):
        """Says why the program cannot go on."""
        self._call("fail", why.encode(errors="replace").replace(b"\0", b" "))

    def leave(self):
        """Leaves the run; the exit code of the program. Nothing of it can be used then."""
        handle, self._handle = self._handle, None
        return self._library.armplane_process_leave(handle)

    def mjcf(self):
        """The arm of the run in MJCF, in base axes. The site `end_effector` is the end-effector, a key the start, a joint's `user` its speed limit."""
        return Path(self.folder, "arm.xml").read_text()
