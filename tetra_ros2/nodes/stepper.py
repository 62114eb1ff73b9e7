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
What decides when the plant takes a step, and what the two know of each other.

A stepper owns the passing of time: when the bodies take a step, how long it is, and which commands
count. The plant owns the bodies, the sensors and the topics. A stepper calls what
:class:`Steppable` declares, and the plant calls what :class:`Stepper` declares; neither knows
more of the other.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from tetra_ros2.ros.diagnostics import Assessment, Health
from tetra_ros2.wire import names

Rate = tuple[float, float, float]
"""An angular velocity (x, y, z) in the body frame [rad/s]."""

STILL: Rate = (0.0, 0.0, 0.0)


class Bodies(Protocol):
    """What can be stepped."""

    @property
    def axes(self) -> Sequence[Rate]:
        """Return the pointing axes, one of each body."""

    def step(self, h: float, rates: Sequence[Rate]) -> None:
        """Let all bodies move for a time ``h`` [s] as they are told."""


class Steppable(Protocol):
    """What a stepper needs of the plant."""

    @property
    def bodies(self) -> Bodies:
        """Return the bodies, which may be others after a reset."""

    def publish(self, stamp: int) -> None:
        """Publish state and measurements as of the time ``stamp`` [ns]."""

    def repeat(self, stamp: int, agents: int) -> None:
        """Publish the measurements of these agents, bits of an integer, once more."""

    def read_commands(self) -> None:
        """Hand over the commands that have come, by calling :meth:`Stepper.command`."""

    def held_agents(self) -> int:
        """Return the agents, as bits, that are held still for a publisher conflict."""

    def create_steady_timer(self, period: float, callback: Callable[[], None], /) -> Any:
        """Return a timer [s] that fires however formation time passes."""

    def create_timer(self, period: float, callback: Callable[[], None], /) -> Any:
        """Return a timer [s] on the node's own clock."""

    def destroy_timer(self, timer: Any) -> Any:
        """Remove a timer."""

    def get_parameter(self, name: str) -> Any:
        """Return a parameter of the node."""

    def get_clock(self) -> Any:
        """Return the node's clock."""

    def offer(self, message_type: type, topic: str, profile: Any, exclusive: bool = False) -> Any:
        """Return a publisher."""


class Stepper(ABC):
    """
    Decides when to step.

    :ivar stamp: time of the newest measurements [ns], 0 before the first
    :ivar steps: how many steps were taken
    :ivar paused: whether the bodies rest
    :ivar clock_shift: how far the clock of the stamps was set since the start, in sum [ns]
    """

    reads_commands: bool
    """Whether it asks for the commands when it needs them; otherwise it wants each at once."""

    def __init__(self, plant: Steppable, agents: Sequence[int]) -> None:
        """
        Be about to begin.

        :param plant: the plant, whose ``bodies`` are there already
        :param agents: indices, from 0, of the agents that see somebody and so have to answer
        """
        self.stamp = 0
        self.steps = 0
        self.paused = False
        self.clock_shift = 0

    @abstractmethod
    def configure(self, values: Mapping[str, Any]) -> None:
        """Take the plant's parameters, before the start and whenever they change."""

    @abstractmethod
    def start(self) -> None:
        """Begin."""

    @abstractmethod
    def stop(self) -> None:
        """Take no step any more."""

    @abstractmethod
    def pause(self, paused: bool) -> None:
        """Let the bodies rest, or go on."""

    @abstractmethod
    def run_until(self, stamp: int) -> None:
        """Go on; where time can wait, pause at the first step at or after a stamp [ns]."""

    @abstractmethod
    def state_changed(self) -> None:
        """Take note that the bodies were moved by other means than a step."""

    @abstractmethod
    def command(self, i: int, stamp: int, rate: Rate) -> None:
        """
        Take the command of agent i as its answer to the measurements of a time.

        :param i: index of the agent, from 0
        :param stamp: time of the measurements [ns]
        :param rate: angular velocity in the body frame [rad/s]
        :raises Rejected: if no such command can count
        """

    @abstractmethod
    def assess(self, health: Health) -> Assessment:
        """Return level, message and figures for the diagnostics."""


def agents_of(bits: int) -> str:
    """Return the names of the agents whose bits are set."""
    return ', '.join(names.agent(i + 1) for i in range(bits.bit_length()) if bits >> i & 1)
