"""A stand-in for CoppeliaSim's ZMQ remote API server, after its PROTOCOL.md: real sockets on the loopback, no scene.

Joints are at their targets one step after they were told, or move by their target velocity.
"""

from __future__ import annotations

import threading
from contextlib import contextmanager

import cbor2
import zmq

FUNCTIONS = [
    "getObject", "setStepping", "step", "startSimulation", "stopSimulation", "getSimulationState",
    "getSimulationTimeStep", "getJointPosition", "setJointPosition", "setJointTargetPosition",
    "setJointTargetVelocity",
]  # fmt: skip


class Double:
    """The scene and what clients asked for."""

    def __init__(self, paths, time_step=0.005, waits=1):
        self.paths, self.time_step, self.waits = list(paths), time_step, waits
        self.calls = []
        self.position, self.target, self.velocity = {}, {}, {}
        self.running = self.stepping = False
        self.mute = False
        self._to_wait = 0

    def reply(self, request):
        function, arguments = request["func"], request.get("args", [])
        if function == "_*executed*_":  # the client has answered a wait
            self._to_wait -= 1
            return {"func": "_*wait*_", "args": []} if self._to_wait > 0 else {"ret": []}
        self.calls.append((function, *arguments))
        if request.get("argsL", len(arguments)) != len(arguments):
            return {"err": "wrong argsL"}
        if function == "zmqRemoteApi.require":
            return {"ret": []}
        if function == "zmqRemoteApi.info":
            return {
                "ret": [{name: {"func": {}} for name in FUNCTIONS} | {"simulation_stopped": {"const": 0}}]
            }
        try:
            return self._sim(function.removeprefix("sim."), *arguments)
        except Exception as error:
            return {"err": str(error)}

    def _sim(self, name, *arguments):
        if name == "getObject":
            if arguments[0] not in self.paths:
                return {"err": f"object does not exist: {arguments[0]}"}
            return {"ret": [100 + self.paths.index(arguments[0])]}
        if name == "step":
            if not (self.running and self.stepping):
                return {"err": "not stepping"}
            self.position.update(self.target)
            for joint, rate in self.velocity.items():
                self.position[joint] += self.time_step * rate
            self._to_wait = self.waits
            return {"func": "_*wait*_", "args": []} if self.waits else {"ret": []}
        if name == "setStepping":
            self.stepping = arguments[0]
        elif name == "startSimulation":
            self.running = True
        elif name == "stopSimulation":
            self.running = False
        elif name == "getSimulationState":
            return {"ret": [17 if self.running else 0]}
        elif name == "getSimulationTimeStep":
            return {"ret": [self.time_step]}
        elif name == "getJointPosition":
            return {"ret": [self.position[arguments[0]]]}
        else:
            table = {"setJointPosition": self.position, "setJointTargetPosition": self.target}
            table.get(name, self.velocity)[arguments[0]] = arguments[1]
        return {"ret": []}


@contextmanager
def serving(double):
    """Serve a double on a free port of the loopback, and give the port."""
    context = zmq.Context()
    socket = context.socket(zmq.REP)
    socket.setsockopt(zmq.LINGER, 0)
    port = socket.bind_to_random_port("tcp://127.0.0.1")
    done = threading.Event()

    def serve():
        while not done.is_set():
            if socket.poll(20):
                request = cbor2.loads(socket.recv())
                if double.mute:
                    done.wait()
                else:
                    socket.send(cbor2.dumps(double.reply(request)))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield port
    finally:
        done.set()
        thread.join()
        socket.close()
        context.term()
