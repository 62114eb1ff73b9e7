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
A recording of a formation as arrays; no ROS in here.

Whoever recorded it: this package's recorder, ``ros2 bag record``, or anything else that keeps the
topics of a formation in a rosbag2 directory.
"""

from array import array
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
import re

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation import rotation
from tetra_ros2.formation._types import Array, JointLimits
from tetra_ros2.formation.checks import Rejected, UNIT_TOLERANCE
from tetra_ros2.formation.identify import Identified, identify
from tetra_ros2.recording import joints
from tetra_ros2.recording.bag import UNFINISHED
from tetra_ros2.recording.joints import Joints
from tetra_ros2.wire import cdr, names

_ATTITUDES_TYPE = 'geometry_msgs/msg/PoseArray'
_COMMAND_TYPE = 'geometry_msgs/msg/TwistStamped'
_EDGE = re.compile(names.relative_attitude(r'(\d+)', r'(\d+)'))
_COMMAND = re.compile(names.cmd_vel(r'(\d+)'))
_JOINTS = re.compile(names.joint_states(r'(\d+)'))

Times = NDArray[np.int64]
"""Times [ns]."""

Key = int | str | tuple[str, int]
"""0 for the state, an agent's number for its commands, ``('joints', i)`` and ``'diagnostics'``."""

Collected = dict[Key, tuple[list[int], list[bytes]]]
"""Times of arrival [ns] and messages."""


@dataclass(frozen=True, eq=False)
class Commands:
    """
    What one agent commanded.

    :param arrived: when each command was recorded [ns], ``(m,)``
    :param stamps: time of the measurements that it answers [ns], ``(m,)``
    :param rates: angular velocities w_i in the body frame [rad/s], ``(m, 3)``
    """

    arrived: Times
    stamps: Times
    rates: Array


@dataclass(frozen=True, eq=False)
class Recording:
    """
    The run of a formation, sample by sample.

    :param path: where it came from
    :param namespace: of the formation, such as ``/`` or ``/left``
    :param arrived: when each state was recorded [ns], ``(k,)``
    :param stamps: of which time it is [ns], strictly increasing, ``(k,)``
    :param gamma: reduced attitudes, unit vectors in the world frame, ``(k, n, 3)``
    :param attitudes: quaternions x y z w, body to world, ``(k, n, 4)``
    :param edges: (i, j) for each edge whose measurements were recorded, from 1
    :param commands: a :class:`Commands` for each agent, from 1, whose commands were recorded
    :param dropped: how many states were not used: repeated, older than one before, or not unit
        vectors
    :param repeated: how many of these say again what the one before said, as a plant does that
        waits or is paused
    :param joints: a :class:`~tetra_ros2.recording.joints.Joints` for each agent, from 1, whose
        body has any and told of them
    :param limits: what each joint can do, by its name, as far as the plant told
    """

    path: Path
    namespace: str
    arrived: Times
    stamps: Times
    gamma: Array
    attitudes: Array
    edges: tuple[tuple[int, int], ...]
    commands: Mapping[int, Commands]
    dropped: int
    repeated: int = 0
    joints: dict[int, Joints] = field(default_factory=dict)
    limits: dict[str, JointLimits] = field(default_factory=dict)

    @property
    def unused(self) -> int:
        """Return how many states that say something of their own were not used."""
        return self.dropped - self.repeated

    @property
    def n(self) -> int:
        """Return the number of agents."""
        return int(self.gamma.shape[1])

    @property
    def times(self) -> Array:
        """Return the time of each state since the first one [s], ``(k,)``."""
        times: Array = (self.stamps - self.stamps[0]) / 1e9
        return times

    @property
    def period(self) -> float | None:
        """Return the time from one state to the next [s], the median; None for a single state."""
        return float(np.median(np.diff(self.stamps))) / 1e9 if len(self.stamps) > 1 else None

    @property
    def body_rates(self) -> Array:
        """Return what each agent commanded in answer to each state [rad/s], ``(k, n, 3)``."""
        return np.stack([self.answers(i) for i in range(1, self.n + 1)], axis=1)

    @cached_property
    def law(self) -> Identified | None:
        """Return the :class:`~tetra_ros2.formation.identify.Identified` law, or None."""
        return identify(
            self.gamma, rotation.rotate(self.attitudes, self.body_rates), self.edges)

    def between(self, start: float, end: float | None = None) -> 'Recording':
        """
        Return the part of it between two times.

        :param start: time since the first state [s]
        :param end: the same; None for the end of the recording
        :raises ConfigurationError: if there are less than two states between them
        """
        times = self.times
        part = (times >= start) & (times <= (np.inf if end is None else end))
        if np.count_nonzero(part) < 2:
            raise ConfigurationError(
                f'holds less than two states from {start:g} s to '
                f'{times[-1] if end is None else end:g} s, it is {times[-1]:g} s long',
                source=self.path)
        stamps = self.stamps[part]
        return replace(self, arrived=self.arrived[part], stamps=stamps, gamma=self.gamma[part],
                       attitudes=self.attitudes[part], joints={
                           i: kept for i, track in self.joints.items()
                           if len((kept := track.between(stamps[0], stamps[-1])).stamps)})

    def answers(self, i: int) -> Array:
        """
        Return the command of agent i that answers each state.

        :param i: the agent, from 1
        :returns: angular velocities in the body frame [rad/s], ``(k, 3)``; NaN where no command
            of the state's own stamp was recorded
        """
        answers = np.full((len(self.stamps), 3), np.nan)
        if i in self.commands:
            commands = self.commands[i]
            order = np.argsort(commands.stamps, kind='stable')
            stamps = commands.stamps[order]
            # The last one of each stamp: an agent that is asked twice answers twice.
            at = np.searchsorted(stamps, self.stamps, side='right') - 1
            found = (at >= 0) & (stamps[at] == self.stamps)
            answers[found] = commands.rates[order[at[found]]]
        return answers

    def ages(self, i: int) -> Array:
        """
        Return how old the newest command of agent i was when each state was recorded [s].

        :param i: the agent, from 1
        :returns: ``(k,)``; NaN before the first command
        """
        ages = np.full(len(self.stamps), np.nan)
        if i in self.commands:
            commands = self.commands[i]
            newest = np.maximum.accumulate(commands.stamps)
            # In lockstep all of a step is recorded at one time, state first: strictly before it.
            at = np.searchsorted(commands.arrived, self.arrived, side='left') - 1
            heard = at >= 0
            ages[heard] = (self.stamps[heard] - newest[at[heard]]) / 1e9
        return ages


def load(path: str | Path, namespace: str | None = None,
         progress: Callable[[float], object] | None = None) -> Recording:
    """
    Read a recording.

    :param path: a rosbag2 directory, MCAP or SQLite
    :param namespace: of the formation to read, where the recording has several
    :param progress: called now and then with how much of it has been read, from 0 to 1
    :raises ConfigurationError: if it cannot be read, or holds no formation
    """
    path = Path(path)
    remedy = f'tetra recover {path} makes a whole one of it'
    if not (path / 'metadata.yaml').is_file():
        problem = 'there is no such directory'
        if path.exists():
            problem = 'is not a rosbag2 directory' + (
                ', it has no metadata.yaml' if path.is_dir() else '')
        if any(path.glob('*.mcap')) or any(path.glob('*.db3')):
            problem = f'was cut off, it has no metadata.yaml: {remedy}'
        raise ConfigurationError(problem, source=path)
    try:
        if UNFINISHED in (path / 'metadata.yaml').read_text(errors='replace'):
            raise ConfigurationError(
                f'was cut off, or is still being written: {remedy}', source=path)
        with Reader(path) as reader:
            namespace = _choose(reader, namespace, path)
            collected = _collect(reader, namespace, progress)
            edges = _edges(reader, namespace)
    except ConfigurationError:
        raise
    # A file that is damaged makes the readers below fail in any way there is.
    except Exception as error:
        reason = (str(error) or type(error).__name__).splitlines()[0].rstrip('.')
        raise ConfigurationError(
            f'cannot be read, it is damaged or was cut off: {reason}; {remedy}',
            source=path) from None
    return _assemble(path, namespace, edges, collected)


def _choose(reader: Reader, wanted: str | None, path: Path) -> str:
    """Return the namespace to read, which is the one that there is or the one that was given."""
    suffix = '/' + names.ATTITUDES
    found = sorted({c.topic[:-len(suffix)] or '/' for c in reader.connections
                    if c.topic.endswith(suffix) and c.msgtype == _ATTITUDES_TYPE and c.msgcount})
    if wanted is not None:
        wanted = '/' + wanted.strip('/')
        if wanted in found:
            return wanted
    if not found:
        raise ConfigurationError(
            f'holds no messages on {names.ATTITUDES}, so there is no formation to see',
            source=path)
    if wanted is None and len(found) == 1:
        return found[0]
    raise ConfigurationError(
        f'holds formations in the namespaces {", ".join(found)}; give one of them',
        source=path, key='--namespace')


def _relative(topic: str, namespace: str) -> str | None:
    """Return a topic's name relative to a namespace, or None if it is not in it."""
    prefix = namespace.rstrip('/') + '/'
    return topic[len(prefix):] if topic.startswith(prefix) else None


def _edges(reader: Reader, namespace: str) -> tuple[tuple[int, int], ...]:
    matches = [_EDGE.fullmatch(_relative(c.topic, namespace) or '') for c in reader.connections]
    return tuple(sorted({(int(m[1]), int(m[2])) for m in matches if m}))


def _collect(reader: Reader, namespace: str,
             progress: Callable[[float], object] | None) -> Collected:
    """Return times of arrival and messages: of the state, commands, joints and diagnostics."""
    keys: dict[int, Key] = {}
    wanted: list[Connection] = []
    for connection in reader.connections:
        relative = _relative(connection.topic, namespace) or ''
        key: Key
        if relative == names.ATTITUDES:
            key = 0
        elif (match := _COMMAND.fullmatch(relative)) and connection.msgtype == _COMMAND_TYPE:
            key = int(match[1])
        elif (match := _JOINTS.fullmatch(relative)) and connection.msgtype == joints.TYPE:
            key = 'joints', int(match[1])
        elif connection.topic == names.DIAGNOSTICS \
                and connection.msgtype == joints.DIAGNOSTICS_TYPE:
            key = 'diagnostics'
        else:
            continue
        keys[connection.id] = key
        wanted.append(connection)
    collected: Collected = defaultdict(lambda: ([], []))
    by_id = {number: collected[key] for number, key in keys.items()}
    total = sum(connection.msgcount for connection in wanted)
    for count, (connection, arrived, message) in enumerate(reader.messages(wanted)):
        times, messages = by_id[connection.id]
        times.append(arrived)
        messages.append(message)
        if progress is not None and not count % 5000:
            progress(count / total)
    if progress is not None:
        progress(1.0)
    return collected


def _assemble(path: Path, namespace: str, edges: Sequence[tuple[int, int]],
              collected: Collected) -> Recording:
    came, messages = collected.pop(0, ([], []))
    n = _agents_in(messages)
    if n < 2:
        raise ConfigurationError(
            f'holds no state of two agents or more on {names.ATTITUDES}', source=path)
    good, stamps, numbers = _decode(messages, cdr.pose_array(names.WORLD, n), 7 * n)
    if not len(good):
        raise ConfigurationError(
            f'holds no valid message on {names.ATTITUDES}, in the frame {names.WORLD!r}',
            source=path)
    arrived = np.array(came, dtype=np.int64)[good]
    poses = numbers.reshape(-1, n, 7)
    lengths = np.linalg.norm(poses[:, :, :3], axis=-1)
    kept = _longest_run(stamps)
    kept = kept[np.all(np.abs(lengths[kept] - 1.0) <= UNIT_TOLERANCE, axis=1)]
    if not len(kept):
        raise ConfigurationError(
            f'holds nothing but invalid directions on {names.ATTITUDES}', source=path)
    told = {i: track for i in range(1, n + 1)
            if (track := joints.read(collected.pop(('joints', i), ((), ()))[1])) is not None}
    limits = joints.limits(
        collected.pop('diagnostics', ((), ()))[1], f'{namespace.rstrip("/")}/{names.PLANT}',
        next(iter(told.values())).names) if told else {}
    commands = {}
    sent_by = {i: sent for i, sent in collected.items() if isinstance(i, int)}
    for i, (times, sent) in sorted(sent_by.items()):
        good, of, numbers = _decode(sent, cdr.twist_stamped(names.body_frame(i)), 6)
        if 1 <= i <= n and len(good):
            commands[i] = Commands(
                np.array(times, dtype=np.int64)[good], of, numbers[:, 3:].copy())
    return Recording(
        path=path, namespace=namespace, arrived=arrived[kept], stamps=stamps[kept],
        gamma=poses[kept, :, :3], attitudes=poses[kept, :, 3:],
        edges=tuple((i, j) for i, j in edges if max(i, j) <= n), commands=commands,
        dropped=len(messages) - len(kept), repeated=int(np.count_nonzero(np.diff(stamps) == 0)),
        joints=told, limits=limits)


def _agents_in(messages: Sequence[bytes]) -> int:
    """Return how many poses the states hold, as far as the first of them tells."""
    for message in messages:
        try:
            return cdr.sequence_length(message)
        except Rejected:
            continue
    return 0


def _longest_run(stamps: Times) -> NDArray[np.intp]:
    """
    Return the indices of the longest run of states in which time only goes forward.

    A state that is repeated is left out. One that is older than the last begins a run of its
    own: the plant was started again, with a clock that was started again.
    """
    ends = np.flatnonzero(np.diff(stamps) < 0) + 1
    runs = np.split(np.arange(len(stamps)), ends)
    run = max(runs, key=len)
    return run[np.diff(stamps[run], prepend=stamps[run[0]] - 1) > 0]


def _decode(messages: Sequence[bytes], codec: cdr.StampedNumbers,
            count: int) -> tuple[NDArray[np.intp], Times, Array]:
    """
    Decode many messages of one type.

    :param messages: bytes
    :param codec: a :class:`~tetra_ros2.wire.cdr.StampedNumbers`
    :param count: how many numbers each holds
    :returns: indices of the good ones, their stamps [ns] and their numbers, ``(m, count)``
    """
    good, stamps, numbers = array('q'), array('q'), array('d')
    decode = codec.decoder()
    for index, message in enumerate(messages):
        try:
            stamp, values = decode(message)
        except Rejected:
            continue
        good.append(index)
        stamps.append(stamp)
        numbers.extend(values)
    return (np.array(good, dtype=int), np.array(stamps, dtype=np.int64),
            np.array(numbers).reshape(-1, count))
