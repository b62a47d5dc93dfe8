"""Listens to a run in progress from outside: its topics are iceoryx2 services. Needs `pip install iceoryx2==0.10.0`."""

import os
import pathlib
import time

import iceoryx2

from . import wire


def subscribe(topic, run=None):
    """The messages of a topic of a run in progress, by default the newest, until it ends; each is valid until the next. A topic has room for two listeners."""
    if run is None:
        living = [path.parent for path in pathlib.Path("/dev/shm").glob("armplane-*/manifest.json")]
        if not living:
            raise FileNotFoundError("no run of armplane is alive")
        run = str(max(living, key=lambda path: path.stat().st_mtime))
    structure, type_name, _ = wire.TOPICS[topic]
    # iceoryx2 compares name, size and alignment of the type; the name has the version of the layout in it.
    structure.type_name = staticmethod(lambda: type_name)
    config = iceoryx2.config.default()
    config.global_cfg.root_path = iceoryx2.Path.new(run)
    config.global_cfg.prefix = iceoryx2.FileName.new(os.path.basename(run) + ".")
    # The launcher clears away the files of a dead process.
    config.global_cfg.node.cleanup_dead_nodes_on_creation = False
    config.global_cfg.node.cleanup_dead_nodes_on_destruction = False
    config.global_cfg.service.cleanup_dead_nodes_on_open = False
    # Its warnings are about files of a run that has ended meanwhile; errors are raised.
    iceoryx2.set_log_level(iceoryx2.LogLevel.Fatal)
    node = iceoryx2.NodeBuilder.new().config(config).create(iceoryx2.ServiceType.Ipc)
    service = node.service_builder(iceoryx2.ServiceName.new(topic)).publish_subscribe(structure).open()
    return _messages(node, service.subscriber_builder().buffer_size(64).create(), run)


def _messages(node, subscriber, run):
    """Polls every millisecond. `node`: kept, for the subscriber lives no longer."""
    while True:
        sample = subscriber.receive()
        if sample is not None:
            yield sample.payload().contents
        elif os.path.isdir(run):
            time.sleep(1e-3)
        else:
            return
