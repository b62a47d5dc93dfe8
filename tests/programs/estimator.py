"""An estimator, standard library only. The argument says how it goes wrong at tick 200 of its first incarnation."""
import atexit, os, signal, struct, sys, threading, time
import armplane

HOW = sys.argv[1] if len(sys.argv) > 1 else ""

class Estimator(armplane.Process):
    q, numbers = None, ()

    def setup(self):
        match HOW:
            case "layout":
                self.joined._call("output", b"estimate", 0x123)
            case "absent":
                os._exit(0)
            case "refuses":
                raise RuntimeError("no licence")
            case "thread":
                threading.Thread(target=lambda: 1 / 0).start()
                time.sleep(1)
            case "at its end":
                atexit.register(lambda: 1 / 0)
            case "hides":
                self.end = 2.5

    def tick(self, tick):
        sensor, estimate, n = self.topics["sensor"], self.topics["estimate"], self.dof
        if self.q is None:
            self.q, self.v = sensor.q_encoder[:n], [0.0] * n
        w, dt = 300.0, self.dt
        for i in range(n):
            e = sensor.q_encoder[i] - (self.q[i] + self.v[i] * dt)
            self.q[i] += self.v[i] * dt + 2 * w * dt * e
            self.v[i] += w * w * dt * e
        estimate.q[:n], estimate.qdot[:n] = self.q, self.v
        estimate.drive, estimate.stale_ticks = sensor.drive, sensor.stale_ticks
        if tick == 200 and self.incarnation == 1:
            self.go_wrong(estimate)
        if tick == 2200 and HOW == "is killed once" and not os.path.exists("once"):
            open("once", "w").close()
            os.kill(os.getpid(), signal.SIGKILL)

    def go_wrong(self, estimate):
        match HOW:
            case "dies":
                os._exit(7)
            case "nan":
                estimate.q[1] = float("nan")
            case "twice":
                self.joined.send()
            case "waits":
                self.joined.wait()
            case "silent":
                time.sleep(60)
            case "raises":
                raise ValueError("no idea")
            case "exits":
                sys.exit(0)
            case "forks":
                if os.fork() == 0:
                    self.joined.wait()
                os.wait()

    def state(self):
        return struct.pack(f"{2 * self.dof}d", *self.q, *self.v)

    def restore(self, state):
        self.numbers = struct.unpack(f"{2 * self.dof}d", state)
        self.q, self.v = list(self.numbers[: self.dof]), list(self.numbers[self.dof :])

    def end(self):
        if self.incarnation > 1:
            print("went on from", len(self.numbers))
        if HOW == "raises late":
            raise ValueError("too late")

Estimator.run()
if HOW == "joins again":
    Estimator.run()
