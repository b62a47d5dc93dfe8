"""One end of a peer that is measured from Python: `peers.py NAME 0|1 BYTES:TRIPS…`, started by the program beside it. The first 20 trips do not count."""

import os
import statistics
import sys
import time
from dataclasses import dataclass


def cyclonedds(me):
    from cyclonedds import core, domain, idl, pub, sub, topic, util

    network = domain.Domain(99, '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"/></Interfaces></General></Domain></CycloneDDS>')
    participant = domain.DomainParticipant(99)
    qos, limit = core.Qos(core.Policy.Reliability.Reliable(10**10)), util.duration(seconds=10)

    def ends(size):
        @dataclass
        class Message(idl.IdlStruct, typename=f"Message{size}"):
            data: idl.types.array[idl.types.uint8, size]

        place = lambda of: topic.Topic(participant, f"{size}_{of}", Message, qos)
        writer, reader, wakes = pub.DataWriter(participant, place(me), qos), sub.DataReader(participant, place(1 - me), qos), core.WaitSet(participant)
        wakes.attach(core.ReadCondition(reader, core.SampleState.Any | core.ViewState.Any | core.InstanceState.Any))

        def receive(network=network):
            while not (came := reader.take()):
                wakes.wait(limit)
            return bytes(came[0].data)

        return lambda message: writer.write(Message(message)), receive

    return ends


def lcm(me):
    from lcm import LCM

    link = LCM(f"udpm://239.255.76.67:{os.environ['PEERS_PORT']}?ttl=0&recv_buf_size=4194304")

    def ends(size):
        came = []
        link.subscribe(f"{size}_{1 - me}", lambda _, message: came.append(message))

        def receive():
            while not came:
                link.handle()
            return came.pop()

        return lambda message: link.publish(f"{size}_{me}", message), receive

    return ends


def main(name, me, *sizes):
    is_first, ends = me == "0", globals()[name](int(me))
    pairs = [(int(size), int(trips), *ends(int(size))) for size, trips in (pair.split(":") for pair in sizes)]
    print("ready", flush=True)
    if is_first:
        sys.stdin.readline()
    for size, trips, send, receive in pairs:
        times = []
        for number in range(trips):
            began = time.perf_counter_ns()
            if is_first:
                send(number.to_bytes(8, "little") + bytes(size - 8))
            message = receive()
            assert len(message) == size and int.from_bytes(message[:8], "little") == number
            if not is_first:
                send(message)
            times.append(time.perf_counter_ns() - began)
        if is_first:
            print(size, statistics.median(times[20:]) / 2e3, flush=True)
    if not is_first:
        sys.stdin.readline()


main(*sys.argv[1:])
