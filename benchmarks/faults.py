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

"""The faults of ``make chaos``: what is done to a formation, and how it is undone."""

from collections.abc import Callable
from dataclasses import dataclass, field
import math
import random
import signal
import struct
import time
from typing import Any

from benchmarks.watcher import SILENT, TYPES
from tetra_ros2.wire import cdr, names

JUMPS = (-3600.0, -60.0, -3.0, 3.0, 60.0, 3600.0)
LAST_SECOND = 2**31 - 1

LONG = 2.0
"""Who is away for so long [s] has to be missed; of less nothing need be seen."""


@dataclass
class Done:
    """
    What was done to a formation.

    :param what: in words
    :param begun: when, on the monotonic clock
    :param owed: what has to be reported; for each such thing regular expressions, one of which
        finds its report
    :param welcome: the same of reports that may come, though none is owed
    :param targets: the nodes that were hit
    """

    what: str
    begun: float
    owed: list[tuple[str, ...]] = field(default_factory=list)
    welcome: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()


Fault = Callable[[Any, random.Random], Done]
"""Takes the rig and a source of chance; does the fault, undoes it, and says what it was."""


def _outage(chance: random.Random) -> float:
    return chance.choice((0.0, chance.uniform(0.1, 0.5), chance.uniform(0.5, 3.0)))


def _absence(rig: Any, begun: float, *targets: str, what: str = '') -> Done:
    """Return a fault that took nodes away from the others until now."""
    outage = time.monotonic() - begun
    owed: list[tuple[str, ...]] = []
    agents = [name for name in targets if name.startswith('agent') and 'plant' not in targets]
    missed = [rf'plant: (?!still ).*\b{name}\b' for name in agents]
    if rig.mode == 'lockstep' and missed:  # the plant asks nothing of who has answered this step
        owed.append(tuple(missed))
    else:
        owed += [(words,) for words in missed]
    if 'plant' in targets:
        owed.append(('nothing heard of', 'waiting for measurements', 'monitor: .*no attitudes'))
    # The rest nobody needs, or who does is away too.
    owed += [(f'{name}: {SILENT}',) for name in targets if name not in ('plant', *agents)]
    everything = tuple(word for words in owed for word in words)
    return Done(what or f'{" and ".join(targets)}, for {outage:.2f} s', begun,
                owed if outage >= LONG else [], everything, targets)


def kill(rig: Any, chance: random.Random) -> Done:
    """Kill -9 a node, and start it again some time later."""
    name, outage = chance.choice(rig.nodes), _outage(chance)
    begun = time.monotonic()
    rig.kill(name)
    time.sleep(outage)
    done = _absence(rig, begun, name)
    rig.start(name)
    return done


def stop(rig: Any, chance: random.Random) -> Done:
    """Stop a node (SIGSTOP), and let it go on."""
    name, outage = chance.choice(rig.nodes), chance.uniform(0.1, 3.0)
    begun = time.monotonic()
    rig.signal(name, signal.SIGSTOP)
    time.sleep(outage)
    done = _absence(rig, begun, name)
    rig.signal(name, signal.SIGCONT)
    return done


def reboot(rig: Any, chance: random.Random) -> Done:
    """Take the power from a host, and start its node again."""
    name, outage = chance.choice(rig.nodes), _outage(chance)
    begun = time.monotonic()
    rig.reboot(name)
    time.sleep(outage)
    done = _absence(rig, begun, name)
    rig.start(name)
    return done


def partition(rig: Any, chance: random.Random) -> Done:
    """Cut one or two hosts off from the rest, and heal the network."""
    cut = chance.sample(rig.nodes, chance.choice((1, 2)))
    outage = chance.uniform(0.1, 4.0)
    begun = time.monotonic()
    rig.hosts.cut(*cut)
    time.sleep(outage)
    done = _absence(rig, begun, *cut)
    rig.hosts.cut()
    return done


def loss(rig: Any, chance: random.Random) -> Done:
    """Lose a share of all frames for some seconds."""
    share, duration = chance.choice((0.1, 0.3, 0.5)), chance.uniform(1.0, 3.0)
    begun = time.monotonic()
    rig.hosts.network(loss=share)
    time.sleep(duration)
    rig.hosts.network()
    return Done(f'{share:.0%} for {duration:.2f} s', begun)


def delay(rig: Any, chance: random.Random) -> Done:
    """Hold all frames back, each by its own time."""
    length, jitter = chance.uniform(0.001, 0.02), chance.uniform(0.0, 0.02)
    duration = chance.uniform(1.0, 3.0)
    begun = time.monotonic()
    rig.hosts.network(delay=length, jitter=jitter)
    time.sleep(duration)
    rig.hosts.network()
    return Done(f'{1e3 * length:.0f} to {1e3 * (length + jitter):.0f} ms for {duration:.2f} s',
                begun)


def clock(rig: Any, chance: random.Random) -> Done:
    """Set the system clock of a host, and set it right again."""
    name, jump = chance.choice(rig.nodes), chance.choice(JUMPS)
    duration = chance.uniform(1.5, 3.0)
    begun = time.monotonic()
    with rig.clock_set(name, jump):
        if name == 'plant' and rig.mode == 'realtime':
            # The library that stands for the clock looks once a second how it is to be set.
            rig.watcher.wait(
                lambda: abs(rig.watcher.stamp / 1e9 - time.time()) > 0.5 * abs(jump), 2.0)
            begun = time.monotonic()
        time.sleep(duration)
    words = ('plant: the clock was set',)
    # In lockstep the plant goes by no clock of the system's.
    owed = [words] if name == 'plant' and rig.mode == 'realtime' else []
    return Done(f'of {name} by {jump:+g} s for {duration:.2f} s', begun, owed, words)


def disk_full(rig: Any, chance: random.Random) -> Done:
    """Fill the disk that the recorder writes to, free it again, and start another recording."""
    duration = chance.uniform(2.5, 4.0)
    with rig.disk_full():
        begun = time.monotonic()
        time.sleep(duration)
    if rig.end_recorder() not in (0, 1):
        raise RuntimeError('the recorder ended with neither 0 nor 1')
    words = ('recorder: not recording any more',)
    return Done(f"the recorder's, for {duration:.2f} s", begun, [words], words, ('recorder',))


def _target(rig: Any, chance: random.Random, what: str) -> tuple[str, str]:
    """Return a topic of a kind, and the frame of its messages."""
    i, j = chance.choice(rig.edges)
    return {
        'measurement': (names.relative_attitude(i, j), names.body_frame(i)),
        'command': (names.cmd_vel(i), names.body_frame(i)),
        'attitudes': (names.ATTITUDES, names.WORLD),
        'diagnostics': ('/diagnostics', ''),
        'clock': (names.CLOCK, ''),
        'error': (names.ERROR, ''),
        'cosines': (names.COSINES, ''),
    }[what]


def _message(what: str, frame: str, stamp: int, numbers: list[float]) -> bytes:
    if what == 'clock':
        return cdr.head(stamp)
    if what == 'measurement':
        return cdr.vector3_stamped(frame).encode(stamp, *numbers[:3])
    if what == 'command':
        return cdr.twist_stamped(frame).encode(stamp, 0.0, 0.0, 0.0, *numbers[:3])
    if what == 'attitudes':
        return cdr.pose_array(frame, 4).encode(stamp, *(numbers * 10)[:28])
    if what == 'error':
        return b'\x00\x01\x00\x00' + struct.pack('<d', numbers[0])
    return b'\x00\x01\x00\x00' + struct.pack('<4d', *(numbers * 2)[:4])


def _with_nanoseconds(message: bytes, nanoseconds: int) -> bytes:
    """Return a stamped message with another, perhaps impossible, part of a second."""
    return message[:8] + struct.pack('<I', nanoseconds) + message[12:]


def _unit(chance: random.Random) -> list[float]:
    vector = [chance.gauss(0.0, 1.0) for _ in range(3)]
    length = math.sqrt(sum(x * x for x in vector))
    return [x / length for x in vector]


def _attack(rig: Any, what: str, topic: str, count: int, duration: float, how: str) -> Done:
    """Return a fault that was said on a topic until now."""
    words: tuple[str, ...] = (topic,)
    if what == 'measurement':
        words += (f'{topic.partition("/")[0]}: dropped',)
    elif what == 'command':
        words += ('plant: dropped',)
    elif what == 'attitudes':
        words += ('monitor: dropped',)
    # Everybody may speak on diagnostics, and in real time nobody has a word for /clock.
    owed = duration >= 1.5 and what != 'diagnostics' and not (
        what == 'clock' and rig.mode == 'realtime')
    return Done(f'{count} on {topic}, {how}', rig.watcher.spoke_at, [words] if owed else [], words)


def forge(rig: Any, chance: random.Random) -> Done:
    """Say something well formed and false on a topic, once or again and again."""
    what = chance.choice(('measurement', 'measurement', 'command', 'command', 'attitudes', 'clock',
                          'error', 'cosines'))
    topic, frame = _target(rig, chance, what)
    ahead = chance.choice((0, 450_000_000, 60_000_000_000, -60_000_000_000, None))
    rate, duration = chance.choice(((1.0, 0.5), (10.0, 2.0), (20.0, 2.0)))
    direction = _unit(chance)

    def message(_k: int) -> bytes:
        stamp = LAST_SECOND * 10**9 + 999_999_999
        if ahead is not None:
            stamp = max(0, rig.watcher.stamp + ahead)
        return _message(what, frame, stamp, direction)

    count = rig.watcher.speak(TYPES[what], topic, message, rate, duration)
    said = 'the last second there is' if ahead is None else f'{ahead / 1e9:+g} s'
    return _attack(rig, what, topic, count, duration, f'stamp {said}')


def malform(rig: Any, chance: random.Random) -> Done:
    """Say what is no message, or holds no numbers, on a topic."""
    what = chance.choice(tuple(TYPES))
    topic, frame = _target(rig, chance, what)
    kinds: dict[str, Callable[[int], bytes]] = {
        'not a number': lambda _: _message(what, frame, rig.watcher.stamp, [math.nan] * 3),
        'infinite': lambda _: _message(what, frame, rig.watcher.stamp, [math.inf] * 3),
        'zero': lambda _: _message(what, frame, rig.watcher.stamp, [0.0] * 3),
        '1e308': lambda _: _message(what, frame, rig.watcher.stamp, [1e308] * 3),
        'impossible nanoseconds': lambda _: _with_nanoseconds(
            _message(what, frame, rig.watcher.stamp, [1.0, 0.0, 0.0]), 4_000_000_000),
        'another frame': lambda _: _message(
            what, 'nowhere', rig.watcher.stamp, [1.0, 0.0, 0.0]),
        'truncated': lambda k: _message(
            what, frame, rig.watcher.stamp, [1.0, 0.0, 0.0])[:4 + k % 40],
        'random bytes': lambda _: bytes(chance.randrange(256) for _ in range(
            chance.randrange(200))),
        'four bytes': lambda _: b'\x00\x01\x00\x00',
        'nothing': lambda _: b'',
        'a huge length': lambda _: b'\x00\x01\x00\x00' + b'\xff' * 60,
    }
    kind = chance.choice(tuple(kinds))
    duration = 1.5
    count = rig.watcher.speak(TYPES[what], topic, kinds[kind], 20.0, duration)
    return _attack(rig, what, topic, count, duration, kind)


def flood(rig: Any, chance: random.Random) -> Done:
    """Say as much as goes on a topic."""
    what = chance.choice(tuple(TYPES))
    topic, frame = _target(rig, chance, what)
    direction, duration = _unit(chance), 1.5
    count = rig.watcher.speak(
        TYPES[what], topic, lambda _: _message(what, frame, 1, direction), 0.0, duration)
    return _attack(rig, what, topic, count, duration, 'as many as go')


FAULTS: dict[str, tuple[int, Fault]] = {
    'kill': (20, kill),
    'stop': (15, stop),
    'reboot': (5, reboot),
    'partition': (12, partition),
    'loss': (6, loss),
    'delay': (6, delay),
    'clock': (8, clock),
    'disk full': (2, disk_full),
    'forged': (12, forge),
    'malformed': (12, malform),
    'flood': (4, flood),
}
"""Each kind of fault, how often it comes in a hundred or so, and what does it."""
