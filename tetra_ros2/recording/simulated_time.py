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

"""Which of the times that are heard on /clock to believe."""

from tetra_ros2.formation.checks import Rejected

STRIDE = 1_000_000_000
"""How far time may go on from one message to the next, whatever the step is [ns]."""

SILENCE = 1_000_000_000
"""How long nothing plausible must have come before a jump is believed [ns], on this machine."""

WITNESSES = 3
"""How many rising times in a row a jump needs to be believed."""


class SimulatedTime:
    """
    The time of /clock, as far as it can be believed.

    Anybody may publish there, and one forged message must not put the rest of a recording into
    another year. Time goes on by small strides. A jump, forwards or back, is believed if nothing
    but jumps has been heard for :data:`SILENCE` and the last :data:`WITNESSES` of them follow on
    from each other: then the plant was started again. The very first time is believed.
    """

    def __init__(self) -> None:
        self.now = 0
        """The time [ns], 0 before there is one."""
        self._heard = 0  # when something plausible came last [ns]
        self._stride = STRIDE
        self._line: list[int] = []  # what could be a time after a jump

    def hear(self, time: int, at: int) -> None:
        """
        Take a time that came on /clock.

        :param time: what it says [ns]
        :param at: when it came, by this machine's clock [ns]
        :raises Rejected: if it is not plausible
        """
        if not 0 < time < 2**31 * 1_000_000_000:
            raise Rejected('implausible time')
        if not self.now or abs(time - self.now) <= self._stride:
            self.now = max(self.now, time)
            self._heard = at
            self._line.clear()
            return
        line = self._line
        if line and not 0 <= time - line[-1] <= max(
                self._stride, 10 * (line[-1] - line[-2]) if len(line) > 1 else time):
            line.clear()
        if not line or time > line[-1]:
            line.append(time)
            del line[:-WITNESSES]
        if len(line) < WITNESSES or at - self._heard < SILENCE:
            raise Rejected('implausible time')
        # Steps may be longer than a stride: a plant may take one in a thousand seconds.
        self._stride = max(STRIDE, 10 * (line[-1] - line[-2]))
        self.now = time
        self._heard = at
        line.clear()
