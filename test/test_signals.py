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

"""A signal that is held back does nothing until it is released."""

import signal

import pytest
from tetra_ros2 import signals


@pytest.fixture
def as_python_begins():
    """Let signals do what they do in a process that nobody has put into the background."""
    before = {number: signal.getsignal(number) for number in signals.SIGNALS}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
    signals._interrupted = False


@pytest.mark.parametrize('released', [True, False])
def test_a_signal_is_held_back_until_it_is_released_or_all_is_over(released, as_python_begins):
    before = signal.getsignal(signal.SIGINT)
    reached = []
    with pytest.raises(KeyboardInterrupt), signals.held_back() as release:
        signal.raise_signal(signal.SIGINT)
        reached.append('went on')
        if released:
            release()
            reached.append('went on after the release')
    assert reached == ['went on']
    assert signal.getsignal(signal.SIGINT) is before


def test_what_a_signal_does_to_those_that_follow_stays(as_python_begins):
    signals.interrupt_once()
    with pytest.raises(KeyboardInterrupt), signals.held_back():
        signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGINT)  # which does nothing any more
    assert signals.interrupted()
