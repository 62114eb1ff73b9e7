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
Looking at a formation from outside: processes to start, and a plain node to listen with.

The node uses message objects and rclpy's default executor, as somebody else's would, and nothing
of the package under test but what keeps it from being deaf after processes were killed, and from
hanging where it leaves while others do.
"""

from collections import defaultdict
import os
import re
import signal
import subprocess
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from tetra_ros2.ros import ports
from tetra_ros2.ros.executor import leave

DEADLINE = 60.0
"""How long anything may take [s]; far more than it does."""

ASK_AGAIN = 5.0
"""How long to wait for an answer before asking again [s]."""

_PORT_TAKEN = re.compile('.*RTPS_TRANSPORT_SHM.*Failed init_port .*: open_and_lock_file .*\n')

NOT_COVERED = pytest.mark.skipif(
    'COVERAGE_RUN' in os.environ,
    reason='coverage loads first in each process, and saves last: a signal would find it instead')
"""For tests of a signal at any moment of a process."""


def until(condition):
    """Wait until a condition holds, and return what it gave."""
    deadline = time.monotonic() + DEADLINE
    while not (result := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return result


class Probe:
    """A node that keeps all messages of the topics it was told to listen to."""

    def __init__(self, namespace=''):
        self.context = Context()
        self.context.init()
        self.node = Node('probe', context=self.context, namespace=namespace)
        ports.reopen_lost(new=True)  # the test before may have killed processes
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.received = defaultdict(list)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        leave(self.executor)

    def listen(self, message_type, topic, depth=10000):
        """Keep what comes on a topic from now on."""
        self.node.create_subscription(
            message_type, topic, self.received[topic].append, depth)

    def wait_for(self, condition, what, timeout=DEADLINE):
        """Spin until a condition holds, and return what it returned."""
        deadline = time.monotonic() + timeout
        while not (result := condition()):
            assert time.monotonic() < deadline, f'{what}: not within {timeout} s{self._told()}'
            self.executor.spin_once(timeout_sec=0.1)
            ports.reopen_lost()
        return result

    def _told(self):
        """Return what the nodes said last of how they are, where that was listened to."""
        last = {status.name: status.message for message in self.received.get('diagnostics', ())
                for status in message.status}
        return ''.join(f'; {name}: {message}' for name, message in last.items())

    def call(self, service_type, name, request):
        """
        Call a service and return its response.

        A server that has not discovered by then who asks drops its answer. So it is asked again
        for what can be asked twice.
        """
        client = self.node.create_client(service_type, name)
        self.wait_for(client.service_is_ready, f'service {name}')
        futures, asked = [client.call_async(request)], time.monotonic()

        def answered():
            nonlocal asked
            if service_type is GetParameters and time.monotonic() - asked > ASK_AGAIN:
                futures.append(client.call_async(request))
                asked = time.monotonic()
            return next((future for future in futures if future.done()), None)

        return self.wait_for(answered, f'answer of {name}').result()

    def health(self, name):
        """Return the last diagnostics of a node, or None; DiagnosticArray must be listened to."""
        for message in reversed(self.received['diagnostics']):
            for status in message.status:
                if status.name == name:
                    return status
        return None

    def wait_for_health(self, name, condition, what):
        """Wait until the diagnostics of a node satisfy a condition, and return them."""
        if 'diagnostics' not in self.received:
            self.listen(DiagnosticArray, 'diagnostics')
        return self.wait_for(
            lambda: (status := self.health(name)) and condition(status) and status, what)

    def listen_to_attitudes(self):
        """Keep the states of the formation."""
        self.listen(PoseArray, 'formation/attitudes')

    def stamp(self):
        """Return the stamp of the last state [ns], or 0."""
        states = self.received['formation/attitudes']
        return nanoseconds(states[-1].header.stamp) if states else 0

    def attitudes(self):
        """Return the last attitudes, quaternions x y z w, ``(n, 4)``."""
        return np.array([
            [p.orientation.x, p.orientation.y, p.orientation.z, p.orientation.w]
            for p in self.received['formation/attitudes'][-1].poses])

    def reduced_attitudes(self):
        """Return the last reduced attitudes, ``(n, 3)``."""
        return np.array([[p.position.x, p.position.y, p.position.z]
                         for p in self.received['formation/attitudes'][-1].poses])


def nanoseconds(stamp):
    """Return a ROS time in nanoseconds."""
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def values(status):
    """Return the figures of a diagnostic status as a mapping of texts."""
    return {item.key: item.value for item in status.values}


class Processes:
    """Processes that are ended, one way or the other, when the test is over."""

    def __init__(self):
        self._started = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in self._started:
            process.kill()
        for process in self._started:
            output, _ = process.communicate()
            print(output, end='')  # which pytest shows where a test fails

    def tetra(self, *arguments):
        """Start ``tetra X`` with these arguments."""
        return self.python('-m', 'tetra_ros2', *arguments)

    def python(self, *arguments):
        """Start Python with these arguments."""
        process = subprocess.Popen(
            [sys.executable, *map(str, arguments)],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self._started.append(process)
        return process


def interrupt(process):
    """End a process as Ctrl-C does; return its exit status and what it printed."""
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=DEADLINE)
    return process.returncode, output


def own_words(text):
    """
    Return what a process said without a line of Fast DDS's: that somebody had a port just then.

    Whoever looks whether the owner of a port lives has it for a moment. The participant takes the
    next one.
    """
    return _PORT_TAKEN.sub('', text)


def run(*arguments, timeout=DEADLINE):
    """Run ``tetra`` to its end; return its exit status, its output and its errors."""
    done = subprocess.run(
        [sys.executable, '-m', 'tetra_ros2', *map(str, arguments)],
        capture_output=True, text=True, timeout=timeout, check=False)
    return done.returncode, done.stdout, own_words(done.stderr)
