# Copyright 2026 The tetra_ros2 authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
A system to measure, in a process of its own; ``python -m benchmarks`` starts these.

A style is ``tetra`` (the nodes of the formation), ``objects`` or ``bytes`` (the baselines). What
is compared takes turns: such a process prints an empty line when it is ready, then reads from its
standard input for how long [s] to run, and in real time at what rate [Hz], runs, prints a line of
JSON about it, and rests until the next. What is measured once prints its line and ends. What is
only there to be measured from outside, an agent or a monitor of a baseline, or a bare node, prints
an empty line when it is ready and runs until SIGINT.

Each role imports what it needs when it begins: the memory of a process and the time that it takes
to start are among what is measured.
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

REST = 0.02
"""How long to go on after a turn, for what is still on its way [s]."""

TRIES = 5
"""How often to begin a turn anew in which a baseline has stood still, as it lost a message."""

WARM_UP, IDLE_RATE = 0.5, 10.0
"""In real time: how long to run before a measurement counts [s], and how fast between two [Hz]."""


def _steady_clock():
    from rclpy.clock import Clock
    from rclpy.clock_type import ClockType
    return Clock(clock_type=ClockType.STEADY_TIME)


def take_turns(measure):
    """Say that this is ready, and measure for as long as is asked for, as often as is asked."""
    print(flush=True)
    for line in sys.stdin:
        print(json.dumps(measure(*map(float, line.split()))), flush=True)


class Spinner:
    """
    A context and an executor, and the nodes in it.

    The default executor is spun without futures and with one and the same time-out: it makes a
    task of every turn in which it waits for a future, and forgets what it was about to do whenever
    the time-out is another.
    """

    def __init__(self, make_executor, namespace):
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        self.context = Context()
        self.context.init()
        self.executor = make_executor(context=self.context)
        self._is_default = isinstance(self.executor, SingleThreadedExecutor)
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

        # A node of the formation may read some of its inputs itself.
        subscriptions = [s for node in self.nodes
                         for s in getattr(node, 'inputs', node.subscriptions)
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

    def run_for(self, seconds, count, at_end):
        """
        Spin for some time, and return whether a count has still grown in the second half of it.

        The executor does not look up while there is work, so that a timer has to look.

        :param count: called without arguments, returns a number
        :param at_end: called when the time is over; what is on its way is done after that
        """
        from rclpy.task import Future
        done = Future(executor=self.executor)
        counts, node, clock = [count()], self.nodes[0], _steady_clock()

        def on_timer():
            counts.append(count())
            if len(counts) == 5:
                at_end()
                timers[0].cancel()
                timers.append(node.create_timer(REST, on_rest, clock=clock))

        def on_rest():
            if not done.done():
                done.set_result(None)

        timers = [node.create_timer(seconds / 4.0, on_timer, clock=clock)]
        self._spin_until(done)
        for timer in timers:
            node.destroy_timer(timer)
        return counts[4] > counts[2]

    def serve(self):
        """Say that this is ready, and spin until SIGINT."""
        from rclpy.executors import ExternalShutdownException
        from rclpy.task import Future
        print(flush=True)
        with suppress(KeyboardInterrupt, ExternalShutdownException):
            self._spin_until(Future(executor=self.executor))

    def _spin_until(self, future):
        while not future.done() and self.context.ok():
            if self._is_default:
                self.executor.spin_once(timeout_sec=0.5)
            else:
                self.executor.spin_until_future_complete(future, timeout_sec=0.1)


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
            return self.stepper.steps

        def resume(self):
            if self.stepper.stamp:
                self.stepper.pause(False)
            else:
                self.stepper.start()

        def pause(self):
            self.stepper.pause(True)

    def agent(i, n, **kwargs):
        return Agent(i, parameter_overrides=_overrides(topology__n=n), **kwargs)

    return BenchedPlant, agent, lambda context: make_executor(context)


def rounds(arguments):
    """Lockstep rounds: plant and agents in this process, or only the plant."""
    n = arguments.n
    plant_type, agent_type, executor_type = _classes(arguments.style)
    spinner = Spinner(executor_type, arguments.namespace)
    plant = spinner.add(plant_type, n)
    if not arguments.alone:
        for i in range(1, n + 1):
            spinner.add(agent_type, i, n)
    spinner.discover(arguments.alone)
    take_turns(turn(spinner, plant, n, again=arguments.style != 'tetra'))


def turn(spinner, plant, n, again=False):
    """
    Return a function that lets the rounds go on for some time, and says how many there were.

    :param plant: what has ``steps``, ``resume`` and ``pause``
    :param again: whether a turn in which the steps stood still is to be begun anew
    """
    # Measurements, commands, the state and the clock.
    messages = n * (n - 1) + n + 2

    def measure(seconds):
        for _ in range(TRIES):
            begun = plant.steps, time.perf_counter(), time.process_time()
            ended = []

            def end(ended=ended):
                ended[:] = plant.steps, time.perf_counter(), time.process_time()
                plant.pause()

            plant.resume()
            if spinner.run_for(seconds, lambda: plant.steps, end) or not again:
                break
        else:
            raise TimeoutError(f'{TRIES} times in a row it stood still')
        count, elapsed, worked = (b - a for a, b in zip(begun, ended))
        if not count:  # a short turn on a busy machine
            return {'rounds': 0, 'rounds/s': 0.0, 'rounds/core s': 0.0, 'us/message': None}
        # The processor's time is that of all threads.
        return {'rounds': count, 'rounds/s': count / elapsed, 'rounds/core s': count / worked,
                'us/message': 1e6 * worked / (count * messages)}

    return measure


def watched(arguments):
    """Lockstep rounds in one process with monitor and recorder; what is lost is counted."""
    from tetra_ros2.launcher import Launcher
    import yaml
    n = arguments.n
    with tempfile.TemporaryDirectory() as directory:
        bag = Path(directory) / 'bag'
        with Launcher('complete', namespace=arguments.namespace, record=bag, seed=7,
                      parameters={'topology.n': n}) as launcher:
            spinner = Spinner.__new__(Spinner)
            spinner.executor, spinner.nodes = launcher.executor, launcher.nodes
            spinner.context = launcher.executor.context
            spinner._is_default = False
            plant = LaunchedPlant(launcher.plant.stepper)
            measure = turn(spinner, plant, n)

            def measure_and_count(seconds):
                figures = measure(seconds)

                def nothing_lost():
                    figures['lost'] = _lost(launcher, n)
                    return not figures['lost']

                # The next repetition goes out while this looks: the counts meet in between.
                with suppress(TimeoutError):
                    spinner.spin(nothing_lost, 5.0)
                return figures

            take_turns(measure_and_count)
        metadata = yaml.safe_load((bag / 'metadata.yaml').read_text())
        on_disk = metadata['rosbag2_bagfile_information']['message_count']
        if on_disk != (counted := sum(launcher.recorder.counts.values())):
            raise RuntimeError(f'{counted} messages were recorded, {on_disk} are in the bag')


class LaunchedPlant:
    """The plant of a launcher as :func:`turn` wants it."""

    def __init__(self, stepper):
        self._stepper = stepper

    @property
    def steps(self):
        return self._stepper.steps

    def resume(self):
        self._stepper.pause(False)

    def pause(self):
        self._stepper.pause(True)


def _lost(launcher, n):
    """Return how many messages monitor and recorder have missed, or recorded too often."""
    recorded = launcher.recorder.counts
    stepper = launcher.plant.stepper
    steps = stepper.steps + 1
    sent = {}  # by topic, at least and at most
    for topic in recorded:
        name = topic.split('/', 2)[-1]
        if name.endswith('cmd_vel'):
            agent = launcher.agents[int(name.split('/')[0].split('_')[1])]
            sent[topic] = 2 * (agent.answers + agent.partial_answers + agent.stops,)
        elif 'relative_attitude' in name:
            # Some repetitions go only to whose answer is missing.
            sent[topic] = steps + stepper.states_repeated, steps + stepper.repetitions
        elif name == 'formation/attitudes':
            sent[topic] = 2 * (steps + stepper.states_repeated,)
        elif name in ('formation/cosines', 'formation/error'):
            sent[topic] = 2 * (steps,)
    missing = sum(max(least - recorded[topic], recorded[topic] - most, 0)
                  for topic, (least, most) in sent.items())
    unheard = (n_topics(n) - len(sent)) * steps
    return missing + unheard + abs(steps - launcher.monitor.observer.count)


def n_topics(n):
    """Return how many topics a recording of n agents has, beside clock and diagnostics."""
    return n * (n - 1) + n + 3


def realtime(arguments):
    """Measure punctuality and freshness of the plant in real time; the agents are elsewhere."""
    import numpy as np
    import punctuality
    from tetra_ros2.ros.executor import spare_collections
    n = arguments.n
    notes = []

    def note(stamp, stamps):
        # Numbers, as tuples would have the garbage collector stop the plant now and then.
        notes.extend((stamp, min(stamps), sum(s >= note.before for s in stamps)))
        note.before = stamp

    note.before = 0
    if arguments.style == 'tetra':
        from tetra_ros2.nodes.plant import Plant
        from tetra_ros2.ros.executor import make_executor
        spinner = Spinner(lambda context: make_executor(context), arguments.namespace)
        plant = spinner.add(Plant, parameter_overrides=_overrides(
            topology__n=n, seed=7, mode='realtime', rate=IDLE_RATE))
        plant.set_rate = lambda rate: plant.set_parameters(_overrides(rate=rate))
        publish, clock = plant.publish, plant.stepper

        def publish_and_note(stamp):
            note(stamp, clock._stamps)
            publish(stamp)

        plant.publish = publish_and_note
    else:
        import baselines
        plant_type = baselines.REAL_TIME_PLANTS[arguments.style]
        spinner = Spinner(_classes(arguments.style)[2], arguments.namespace)
        plant = spinner.add(plant_type, n, note)
    spinner.discover(alone=True)
    spare_collections()

    def measure(seconds, rate):
        plant.set_rate(rate)
        spinner.run_for(WARM_UP, lambda: len(notes), lambda: None)
        notes.clear()
        noted = []
        spinner.run_for(seconds, lambda: len(notes), lambda: noted.extend(notes))
        plant.set_rate(IDLE_RATE)
        return punctuality.judge(np.array(noted).reshape(-1, 3), n, rate)

    plant.set_rate(IDLE_RATE)
    take_turns(measure)


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
    """Trajectories by a method, to a given final error."""
    import trajectories
    take_turns(trajectories.prepare(arguments.style, arguments.threads, arguments.core))


def main():
    """Be the system that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('system')
    parser.add_argument('style', nargs='?', default='tetra')
    parser.add_argument('--namespace', default='')
    parser.add_argument('--n', type=int, default=4)
    parser.add_argument('--id', type=int, default=1)
    parser.add_argument('--steps', type=int, default=1_000_000)
    parser.add_argument('--threads', type=int, default=1)
    parser.add_argument('--core', type=int)
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
