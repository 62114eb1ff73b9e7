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

"""What the nodes of a formation have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from functools import partial
from typing import Any, TYPE_CHECKING

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from tetra_ros2.ros import ports
from tetra_ros2.ros.diagnostics import Assessment, Health

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger


def raw_publish(publisher: Publisher) -> Callable[[bytes], None]:
    """
    Return the function that publishes bytes, the quickest there is.

    ``Publisher.publish`` takes as long again to look what it was given, and to keep the publisher
    from being destroyed meanwhile. Here bytes are all that is given, and the thread that publishes
    is the one that destroys; after that, this function raises an error.
    """
    return getattr(publisher.handle, 'publish_raw', publisher.publish)


class FormationNode(Node):
    """
    A node that can name its own topics, and reports on ``diagnostics``.

    A subclass hands what assesses it to :meth:`report_health`, as soon as that can answer.

    :param args: the node's name, and what rclpy's Node takes beside it
    """

    if TYPE_CHECKING:  # what rclpy has without types
        def get_logger(self) -> RcutilsLogger:
            """Return what logs in the node's name."""

        def destroy_node(self) -> None:
            """Destroy the node."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        ports.reopen_lost(new=True)  # the first node of a context makes some
        self.inputs: list[Subscription] = []
        self.outputs: list[Publisher] = []
        self._queued: list[Subscription] = []  # those that this node reads itself
        self.exclusive_outputs: list[str] = []  # names of topics on which nobody else may publish
        self.exclusive_inputs = True  # whether one publisher is right for each subscription
        self.health: Health = None  # type: ignore[assignment]  # until report_health()
        # One for all timers of the node: the events executor keeps a thread for each clock.
        self.steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.exit_status = 0  # of the process that runs this node

    # Profiles are copied: rclpy writes what is overridden into the very object it is given.

    def listen(self, message_type: type, topic: str, callback: Callable[[bytes], None],
               profile: QoSProfile, guarded: bool = True) -> Subscription:
        """
        Subscribe to the bytes of a topic, with quality of service open to overrides.

        :param guarded: whether what the callback raises is survived here; otherwise it does so
            itself, which is quicker
        :returns: the subscription
        """
        receive: Callable[[bytes], None] = self._guard(callback) if guarded else callback
        subscription: Subscription = self.create_subscription(
            message_type, topic, receive, copy(profile), raw=True,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._misfit(
                topic, 'publishers', lambda: self._relax(subscription))),
            qos_overriding_options=self._overriding(topic))
        self.inputs.append(subscription)
        return subscription

    def _overriding(self, topic: str) -> QoSOverridingOptions | None:
        """
        Return the options for a topic whose quality of service the user overrides, else None.

        For each topic they bring three parameters, which take as long as the topic itself.
        """
        prefix = f'qos_overrides.{self.resolve_topic_name(topic)}.'
        overridden = any(name.startswith(prefix) for name in self._parameter_overrides)
        return QoSOverridingOptions.with_default_policies() if overridden else None

    def _relax(self, subscription: Subscription) -> None:
        """
        Subscribe with best effort, which goes with every publisher, in the place of reliably.

        Drivers of sensors offer best effort.
        """
        if subscription not in self.inputs or subscription in self._queued:
            return
        topic = subscription.topic_name
        profile = copy(subscription.qos_profile)
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
        self.inputs[self.inputs.index(subscription)] = self.create_subscription(
            subscription.msg_type, topic, subscription.callback, profile, raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=self._misfit(topic, 'publishers')))
        self.destroy_subscription(subscription)
        self.get_logger().info(f'{topic}: taken with best effort, as its publisher offers no more')

    def _guard(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback that survives whatever it raises, and has it counted."""
        def guarded(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except ExternalShutdownException:
                raise
            except Exception as error:
                if self.health is None:
                    raise
                self.health.survive(error)
                return arguments[-1] if len(arguments) == 2 else None  # a service's response
        return guarded

    def _misfit(self, topic: str, who: str,
                relax: Callable[[], None] | None = None) -> Callable[[Any], None]:
        """
        Return what names quality of service that does not fit for what it is.

        :param who: who else is on the topic: ``publishers`` or ``subscribers``
        :param relax: called, soon, if it is only their reliability that does not do, and the user
            has not asked for it
        """
        name = self.resolve_topic_name(topic)
        asked = f'qos_overrides.{name}.subscription.reliability' in self._parameter_overrides

        def on_incompatible(event: Any) -> None:
            policy = event.last_policy_kind
            if relax is not None and policy == QoSPolicyKind.RELIABILITY and not asked:
                def soon() -> None:
                    self.destroy_timer(timer)
                    relax()

                # Not now: what has the event is what is to be destroyed.
                timer = self.create_steady_timer(0.0, soon)
                return
            self.get_logger().warning(
                f'{name}: {event.total_count} {who} have a quality of service that does not fit, '
                f'the last in its {QoSPolicyKind(policy).name.lower()}')
        return on_incompatible

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Give the subscriptions that an executor is to look after."""
        return (s for s in super().subscriptions if s not in self._queued)

    def queue(self, subscription: Subscription) -> Callable[[], tuple[Any, Any] | None]:
        """
        Read a subscription's messages when it suits this node, instead of being called for each.

        To be called, in an executor that has to wake for it, costs more than the message.

        :returns: a function that gives the next message, in bytes if the subscription is raw, and
            what is known about it, a mapping; or None if there is none
        """
        self._queued.append(subscription)
        return partial(subscription.handle.take_message, subscription.msg_type, subscription.raw)

    def offer(self, message_type: type, topic: str, profile: QoSProfile,
              exclusive: bool = False) -> Publisher:
        """
        Return a publisher, with quality of service open to overrides.

        :param exclusive: whether somebody else on the topic is a mistake to be reported
        """
        publisher = self.create_publisher(
            message_type, topic, copy(profile),
            event_callbacks=PublisherEventCallbacks(
                incompatible_qos=self._misfit(topic, 'subscribers')),
            qos_overriding_options=self._overriding(topic))
        self.outputs.append(publisher)
        if exclusive:
            self.exclusive_outputs.append(publisher.topic_name)
        return publisher

    def create_timer(self, timer_period_sec: float, callback: Callable[[], Any], *args: Any,
                     **kwargs: Any) -> Timer:
        """Return a timer [s] whose callback may fail and is called again all the same."""
        return super().create_timer(timer_period_sec, self._guard(callback), *args, **kwargs)

    def create_service(self, srv_type: Any, srv_name: str, callback: Callable[[Any, Any], Any],
                       *args: Any, **kwargs: Any) -> Service:
        """Return a service that answers even if its callback fails."""
        return super().create_service(
            srv_type, srv_name, self._guard(callback), *args, **kwargs)

    def create_steady_timer(self, period: float, callback: Callable[[], Any]) -> Timer:
        """Return a timer [s] that fires however formation time passes."""
        return self.create_timer(period, callback, clock=self.steady_clock)

    def publisher_conflicts(self) -> list[str]:
        """Return the topics with more than one publisher where one is right."""
        topics = {topic for topic in self.exclusive_outputs if self.count_publishers(topic) > 1}
        if self.exclusive_inputs:
            topics |= {s.topic_name for s in self.inputs if s.get_publisher_count() > 1}
        return sorted(topics)

    def report_health(self, assess: Callable[[], Assessment]) -> None:
        """
        Begin to report on ``diagnostics``.

        :param assess: returns level, message and figures, see
            :class:`~tetra_ros2.ros.diagnostics.Health`
        """
        self.health = Health(self, assess)

    def close(self) -> None:
        """Do what is to be done while the node can still publish."""
