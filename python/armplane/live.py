"""Listens to a run in progress from outside: its topics are iceoryx2 services. Needs `pip install iceoryx2==0.10.0`."""

import os
import pathlib
import time

import iceoryx2

from . import wire


class Subscriber:
    """The messages of one topic of a run in progress, by default the newest. Each topic has room for two such listeners."""

    def __init__(self, topic, run=None, depth=64):
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
        self.run = run
        self._node = iceoryx2.NodeBuilder.new().config(config).create(iceoryx2.ServiceType.Ipc)
        service = self._node.service_builder(iceoryx2.ServiceName.new(topic)).publish_subscribe(structure).open()
        self._subscriber = service.subscriber_builder().buffer_size(depth).create()

    def receive(self):
        """The oldest message not yet seen, or `None`. It is valid until the next call."""
        self._sample = self._subscriber.receive()
        return None if self._sample is None else self._sample.payload().contents

    def __iter__(self):
        """All messages until the run ends, polled every millisecond."""
        while True:
            message = self.receive()
            if message is not None:
                yield message
            elif os.path.isdir(self.run):
                time.sleep(1e-3)
            else:
                return
