# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
One measurement in a fresh process: a system to run, and one line of JSON about it.

``tetra bench`` starts these. A style is ``tetra`` (the nodes of the formation), ``objects`` or
``bytes`` (the baselines). What is only there to be measured from outside, an agent or a monitor
of a baseline, or a bare node, prints an empty line when it is ready and runs until SIGINT.
"""

import argparse
from collections import Counter
from contextlib import suppress
import json
from pathlib import Path
import sys
import tempfile
import time

DISCOVERY_TIMEOUT = 60.0
SETTLING_TIME = 0.5
"""How long to wait after everybody has been found: the other side may learn of it later [s]."""

STALL_TIMEOUT = 2.0
"""Without a step for this long [s], a baseline that has lost a message is begun anew."""

GIVING_UP = 20.0
"""Without a step for this long [s], nothing is measured."""

ON_TIME = 0.25e-3
"""How late a step may be that counts as in time [s]."""


def _steady_clock():
    from rclpy.clock import Clock
    from rclpy.clock_type import ClockType
    return Clock(clock_type=ClockType.STEADY_TIME)


class Spinner:
    """A context and an executor, and the nodes in it."""

    def __init__(self, make_executor, namespace):
        from rclpy.context import Context
        self.context = Context()
        self.context.init()
        self.executor = make_executor(context=self.context)
        self.nodes = []
        self._kwargs = {'context': self.context, 'namespace': namespace}

    def add(self, make_node, *args, **kwargs):
        """Make a node, and spin it from now on."""
        node = make_node(*args, **self._kwargs, **kwargs)
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def spin(self, until, timeout):
        """Spin in short turns until a condition holds; it is not looked at under load."""
        from rclpy.task import Future
        deadline = time.monotonic() + timeout
        never = Future(executor=self.executor)
        while not until():
            if time.monotonic() > deadline:
                raise TimeoutError(f'not within {timeout:g} s')
            self.executor.spin_until_future_complete(never, timeout_sec=0.02)

    def discover(self, alone):
        """
        Spin until the publishers and subscriptions of all nodes have found their other ends.

        :param alone: whether one node of these is here alone, and the others are elsewhere
        """
        def ours(topic):
            return any(word in topic for word in ('cmd_vel', 'relative_', 'attitudes'))

        subscriptions = [s for node in self.nodes for s in node.subscriptions
                         if ours(s.topic_name)]
        publishers = [p for node in self.nodes for p in node.publishers if ours(p.topic_name)]
        listeners = Counter(s.topic_name for s in subscriptions)

        def complete():
            return all(
                p.get_subscription_count() >= (1 if alone else listeners[p.topic_name])
                for p in publishers) and all(s.get_publisher_count() for s in subscriptions)

        self.spin(complete, DISCOVERY_TIMEOUT)
        end = time.monotonic() + SETTLING_TIME
        self.spin(lambda: time.monotonic() > end, DISCOVERY_TIMEOUT)

    def sample(self, plant, count, seconds, warmup, restart=None, least=0):
        """
        Return how much a count grew over some time, that time, and the processor's share [s].

        The executor does not look up while there is work: the samples are taken in a timer.

        :param plant: the node that gets the timer
        :param count: called without arguments, returns a number or an array
        :param least: go on until the count has grown by this much
        :param restart: called if nothing has happened for STALL_TIMEOUT
        """
        from rclpy.task import Future
        done = Future(executor=self.executor)
        begun = time.perf_counter()
        samples, alive, restarted = [], [begun, None], [begun]

        def on_timer():
            now, value = time.perf_counter(), count()
            if value != alive[1]:
                alive[:] = now, value
            elif now - alive[0] > GIVING_UP and not done.done():
                done.set_exception(TimeoutError(f'no step for {GIVING_UP:g} s'))
            elif restart is not None and now - max(alive[0], restarted[0]) > STALL_TIMEOUT:
                restarted[0] = now
                restart()
            if not samples:
                if now - begun >= warmup and value:
                    print(flush=True)  # to whom it concerns
                    samples.append((now, value, time.process_time()))
            elif done.done():
                pass
            elif now - samples[0][0] >= seconds and value - samples[0][1] >= least:
                samples.append((now, value, time.process_time()))
                done.set_result(None)

        timer = plant.create_timer(0.01, on_timer, clock=_steady_clock())
        while not done.done():
            self.executor.spin_until_future_complete(done, timeout_sec=0.1)
        done.result()
        plant.destroy_timer(timer)
        (t0, a, c0), (t1, b, c1) = samples
        return b - a, t1 - t0, c1 - c0

    def serve(self):
        """Say that this is ready, and spin until SIGINT."""
        from rclpy.executors import ExternalShutdownException
        print(flush=True)
        try:
            while self.context.ok():
                self.spin(lambda: False, 0.5)
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        except TimeoutError:
            self.serve()


def _overrides(**values):
    from rclpy.parameter import Parameter
    return [Parameter(k.replace('__', '.'), value=v) for k, v in values.items()]


def _classes(style):
    """Return plant, agent, and what makes an executor, of a style, called alike."""
    if style != 'tetra':
        import baselines
        return {'objects': baselines.OBJECTS, 'bytes': baselines.BYTES}[style]
    from tetra_ros2.nodes.agent import Agent
    from tetra_ros2.nodes.plant import Plant
    from tetra_ros2.ros.executor import make_executor

    class BenchedPlant(Plant):
        """The plant as it is, with the names of the baselines'."""

        def __init__(self, n, **kwargs):
            super().__init__(start=False, parameter_overrides=_overrides(
                topology__n=n, seed=7), **kwargs)

        @property
        def steps(self):
            return self.time.steps

        @property
        def repetitions(self):
            return self.time.repetitions

        def begin(self):
            self.time.start()

    def agent(i, n, **kwargs):
        return Agent(i, parameter_overrides=_overrides(topology__n=n), **kwargs)

    return BenchedPlant, agent, lambda context: make_executor(context)


def rounds(arguments):
    """Measure lockstep rounds per second: plant and agents in this process, or only the plant."""
    n = arguments.n
    plant_type, agent_type, executor_type = _classes(arguments.style)
    spinner = Spinner(executor_type, arguments.namespace)
    if not arguments.alone:
        for i in range(1, n + 1):
            spinner.add(agent_type, i, n)
    plant = spinner.add(plant_type, n)
    spinner.discover(arguments.alone)
    plant.begin()
    restart = None if arguments.style == 'tetra' else plant.begin
    count, elapsed, worked = spinner.sample(
        plant, lambda: plant.steps, arguments.seconds, arguments.warmup, restart,
        arguments.rounds)
    # Measurements, commands, the state and the clock; the processor's time, of all threads.
    messages = n * (n - 1) + n + 2
    return {'rounds': count, 'rounds/s': count / elapsed, 'rounds/core s': count / worked,
            'us/message': 1e6 * worked / (count * messages),
            'repetitions': getattr(plant, 'repetitions', 0)}


def watched(arguments):
    """Measure lockstep rounds per second with monitor and recorder, and count what is lost."""
    import yaml

    from tetra_ros2.launcher import Launcher
    with tempfile.TemporaryDirectory() as directory:
        bag = Path(directory) / 'bag'
        with Launcher('complete', namespace=arguments.namespace, record=bag, seed=7,
                      parameters={'topology.n': arguments.n}) as launcher:
            plant, time_of = launcher.plant, launcher.plant.time
            spinner = Spinner.__new__(Spinner)
            spinner.executor = launcher.executor
            count, elapsed, worked = spinner.sample(
                plant, lambda: time_of.steps, arguments.seconds, arguments.warmup)
            time_of.run_until(time_of.stamp)

            def expected():
                sent = time_of.steps + 1 + time_of.repetitions
                counts = {}
                for topic in launcher.recorder.counts:
                    name = topic.split('/', 2)[-1]
                    if name.endswith('cmd_vel'):
                        agent = launcher.agents[int(name.split('/')[0].split('_')[1])]
                        counts[topic] = agent.answers + agent.partial_answers
                    elif 'relative_attitude' in name or name == 'formation/attitudes':
                        counts[topic] = sent
                    elif name in ('formation/cosines', 'formation/error'):
                        counts[topic] = time_of.steps + 1
                return counts

            def lost():
                recorded = launcher.recorder.counts
                return sum(abs(sent - recorded[topic]) for topic, sent in expected().items())

            # The next repetition goes out while this looks: the counts meet in between.
            with suppress(TimeoutError):
                spinner.spin(lambda: not lost(), 5.0)
            missing, topics = lost(), len(expected())
            unseen = time_of.steps + 1 - launcher.monitor.observer.count
        metadata = yaml.safe_load((bag / 'metadata.yaml').read_text())
        on_disk = metadata['rosbag2_bagfile_information']['message_count']
        counted = sum(launcher.recorder.counts.values())
        complete = n_topics(arguments.n) == topics
        return {'rounds': count, 'rounds/s': count / elapsed, 'recorded': on_disk,
                'rounds/core s': count / worked,
                'lost': missing + abs(unseen) + abs(counted - on_disk) if complete else counted}


def n_topics(n):
    """Return how many topics a recording of n agents has, beside clock and diagnostics."""
    return n * (n - 1) + n + 3


def realtime(arguments):
    """Measure punctuality and freshness of the plant in real time; the agents are elsewhere."""
    import numpy as np
    n, rate = arguments.n, arguments.rate
    notes = []

    def note(stamp, stamps):
        notes.append((stamp, min(stamps), sum(s >= note.before for s in stamps)))
        note.before = stamp

    note.before = 0
    if arguments.style == 'tetra':
        from tetra_ros2.nodes.plant import Plant
        from tetra_ros2.ros.executor import make_executor
        spinner = Spinner(lambda context: make_executor(context), arguments.namespace)
        plant = spinner.add(Plant, parameter_overrides=_overrides(
            topology__n=n, seed=7, mode='realtime', rate=rate))
        publish, clock = plant.publish, plant.time

        def publish_and_note(stamp):
            note(stamp, clock._stamps)
            publish(stamp)

        plant.publish = publish_and_note
    else:
        import baselines
        plant_type, executor_type = baselines.ObjectRealTimePlant, baselines.OBJECTS[2]
        spinner = Spinner(executor_type, arguments.namespace)
        plant = spinner.add(plant_type, n, rate, note)
    spinner.discover(alone=True)
    spinner.sample(plant, lambda: len(notes), 0.01, arguments.warmup)
    before = len(notes)
    spinner.sample(plant, lambda: len(notes), arguments.seconds, 0.0)
    return judge(np.array(notes[before:]), n, rate)


def judge(notes, n, rate):
    """
    Say how punctual and how fresh a run in real time was.

    :param notes: for each step its time, the oldest stamp among the commands that it applied
        [ns], and how many of these answer the step before, ``(m, 3)``
    """
    import numpy as np
    stamps, oldest, fresh = notes.T
    period = 1e9 / rate
    since = stamps - stamps[0]
    # The schedule is where most steps are, at the early edge of them: a timer is never early.
    # First about the mean on the circle, as a step may be late by more than half a period.
    middle = np.angle(np.mean(np.exp(2j * np.pi * since / period))) / (2.0 * np.pi) * period
    offsets = since - middle
    since = since - middle - np.quantile(offsets - np.round(offsets / period) * period, 0.05)
    tolerance = min(50e3, 0.2 * period)
    slots = np.floor((since + tolerance) / period)
    late = since - slots * period
    skipped = np.diff(slots, prepend=slots[0] - 1) > 1
    # Behind a gap it cannot be told which slot a step was for: that one counts as late.
    on_time = (late <= ON_TIME * 1e9) & ~skipped
    scheduled = slots[-1] - slots[0] + 1
    ages = np.arange(len(stamps)) - np.searchsorted(stamps, oldest)
    return {'steps': len(stamps), 'steps/s': 1e9 * (len(stamps) - 1) / (stamps[-1] - stamps[0]),
            'on time': len(np.unique(slots[on_time])) / scheduled,
            'fresh': float(fresh[1:].sum() / (n * (len(stamps) - 1))),
            'oldest [steps]': int(ages[1:].max()),
            'jitter p50 [ms]': float(np.quantile(late, 0.5) / 1e6),
            'jitter p99 [ms]': float(np.quantile(late, 0.99) / 1e6)}


def agent(arguments):
    """Be one agent of a baseline."""
    _, agent_type, executor_type = _classes(arguments.style)
    spinner = Spinner(executor_type, arguments.namespace)
    spinner.add(agent_type, arguments.id, arguments.n)
    spinner.serve()


def monitor(arguments):
    """Be the monitor of the baseline of bytes."""
    import baselines
    spinner = Spinner(baselines.BYTES[2], arguments.namespace)
    spinner.add(baselines.ByteMonitor, arguments.n)
    spinner.serve()


def bare(arguments):
    """Be a node that does nothing, as one first writes it."""
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from rclpy.node import Node
    rclpy.init()
    node = Node('bare', namespace=arguments.namespace)
    print(flush=True)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


def first_command(arguments):
    """Say when the first command of agent 1 is there, on the clock that all processes share."""
    from geometry_msgs.msg import TwistStamped
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node
    spinner = Spinner(SingleThreadedExecutor, arguments.namespace)
    node = spinner.add(Node, 'watch')
    seen = []
    node.create_subscription(TwistStamped, 'agent_1/cmd_vel',
                             lambda _: seen.append(time.monotonic()), 10)
    print(flush=True)
    spinner.spin(lambda: seen, 60.0)
    return {'at': seen[0]}


def drift(arguments):
    """Turn a rigid body very often, and say how far its attitude then is off SO(3)."""
    import numpy as np

    from tetra_ros2.formation.bodies import RigidBodies
    from tetra_ros2.formation.rotation import random
    rng = np.random.default_rng(1)
    bodies = RigidBodies(random(rng, (1,)), [(1.0, 0.0, 0.0)])
    rates = [[tuple(w)] for w in rng.normal(scale=3.0, size=(1009, 3)).tolist()]
    begun = time.perf_counter()
    step = bodies.step
    for k in range(arguments.steps):
        step(0.01, rates[k % 1009])
    elapsed = time.perf_counter() - begun
    x, y, z, w = bodies.attitudes[0]
    # Columns of R_i, from how it turns the basis; R^T R - 1, the largest entry.
    matrix = np.array([
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z]])
    return {'drift': float(np.abs(matrix.T @ matrix - np.eye(3)).max()),
            'steps/s': arguments.steps / elapsed}


def batch(arguments):
    """Measure how many trajectories a second a method follows to a given final error."""
    import trajectories
    return trajectories.measure(arguments.style, arguments.threads, arguments.seconds)


def main():
    """Run one measurement."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('system')
    parser.add_argument('style', nargs='?', default='tetra')
    parser.add_argument('--namespace', default='')
    parser.add_argument('--n', type=int, default=4)
    parser.add_argument('--id', type=int, default=1)
    parser.add_argument('--rate', type=float, default=2000.0)
    parser.add_argument('--seconds', type=float, default=2.0)
    parser.add_argument('--warmup', type=float, default=0.5)
    parser.add_argument('--steps', type=int, default=1_000_000)
    parser.add_argument('--rounds', type=int, default=0)
    parser.add_argument('--threads', type=int, default=1)
    parser.add_argument('--alone', action='store_true', help='the plant only')
    arguments = parser.parse_args()
    systems = {f.__name__: f for f in (
        rounds, watched, realtime, agent, monitor, bare, first_command, drift, batch)}
    result = systems[arguments.system](arguments)
    if result is not None:
        print(json.dumps(result), flush=True)
    # What DDS still does at the end of a process is not part of any measurement.
    sys.stdout.flush()


if __name__ == '__main__':
    main()
