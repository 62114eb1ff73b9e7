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

"""One node of this package, spun in the test's own process, and a way to talk to it."""

from collections import Counter

from harness import values
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.task import Future
from tetra_ros2.ros.executor import leave, make_executor, spin_some


class Bench:
    """One node under test, spun together with a probe."""

    def __init__(self, probe, node_type, *args, **parameters):
        self.probe = probe
        self.context = Context()
        self.context.init()
        self.executor = make_executor(self.context)
        self.node = node_type(*args, context=self.context, parameter_overrides=[
            Parameter(key.replace('__', '.'), value=value) for key, value in parameters.items()])
        self.executor.add_node(self.node)
        self._never = Future(executor=self.executor)
        self._publishers = Counter()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.node.close()
        leave(self.executor)

    def wait_for(self, condition, what):
        def step():
            spin_some(self.executor, self._never, timeout=0.005)
            return condition()
        return self.probe.wait_for(step, what)

    def publisher(self, message_type, topic):
        publisher = self.probe.node.create_publisher(message_type, topic, 10)
        subscription, = (s for s in self.node.inputs if s.topic_name == f'/{topic}')
        self._publishers[topic] += 1
        # Each end learns of the other by itself; a message in between would be lost.
        self.wait_for(lambda: publisher.get_subscription_count()
                      and subscription.get_publisher_count() >= self._publishers[topic],
                      f'both ends of {topic}')
        return publisher

    def rejects(self, publisher, message, reason):
        """Publish a message and wait until it has been dropped for this reason."""
        before = self.node.health.rejected.total()
        publisher.publish(message)
        self.wait_for(lambda: self.node.health.rejected.total() > before, f'rejection: {reason}')
        assert any(key.startswith(reason) for key in self.node.health.rejected), \
            self.node.health.rejected

    def is_reported(self):
        """Wait until the diagnostics tell of all that was dropped."""
        name = self.node.get_fully_qualified_name()
        total = str(self.node.health.rejected.total())

        def told():
            status = self.probe.health(name)
            return status and values(status)['rejected'] == total and status

        status = self.wait_for(told, 'the report')
        for reason, count in self.node.health.rejected.items():
            assert values(status)[f'rejected: {reason}'] == str(count)
