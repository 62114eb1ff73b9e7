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

"""The health of a node: what it counts, and how it tells."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
import time
from typing import Any, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from tetra_ros2.ros import qos
from tetra_ros2.wire import names

if TYPE_CHECKING:
    from tetra_ros2.formation.checks import Rejected
    from tetra_ros2.ros.node import FormationNode

Assessment = tuple[bytes, str, dict[str, Any]]
"""How a node is: a level, one of the three below, a message and figures."""

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR

MOST_REASONS = 50
"""How many reasons are counted apart; an intruder could think of ever new ones."""

PERIOD = 0.5
"""How often a node reports [s], on a clock that runs even when formation time does not."""


class Health:
    """
    Counts what a node rejects, and reports on ``diagnostics`` twice a second.

    What is counted in between is logged with the report, so that a flood of bad messages makes
    one line for each report.

    :param node: the rclpy node
    :param assess: called without arguments; returns ``(level, message, values)``, the state of
        the node in a word, and a mapping of figures
    """

    def __init__(self, node: FormationNode, assess: Callable[[], Assessment]) -> None:
        self.rejected: Counter[str] = Counter()
        self.exceptions = 0  # raised by callbacks, and survived
        self._last_exception = ''
        self.message = ''  # of the last report
        self._node = node
        self._assess = assess
        self._logged: Counter[str] = Counter()
        self._exceptions_told = 0
        self._level: bytes = OK
        self._counts: dict[str, int] = {}
        self._counted_at = time.monotonic()
        self._publisher = node.offer(DiagnosticArray, names.DIAGNOSTICS, qos.REPORTS)
        self._timer = node.create_steady_timer(PERIOD, self.report)

    def reject(self, reason: Rejected | str, source: str) -> None:
        """Count a message that was dropped: why, and on which topic or of whom."""
        key = f'{reason} ({source})'
        if len(self.rejected) >= MOST_REASONS and key not in self.rejected:
            key = f'{str(reason).partition(":")[0]} (and others)'
        self.rejected[key] += 1

    def survive(self, error: Exception) -> None:
        """Count what a callback has raised, log it, and go on."""
        self.exceptions += 1
        self._last_exception = f'{type(error).__name__}: {error}'
        self._node.get_logger().error(
            f'survived: {self._last_exception}', throttle_duration_sec=PERIOD)

    def rates(self, counts: Mapping[str, int]) -> dict[str, float]:
        """
        Return how often things happened since the last call [Hz], given how often they ever did.

        :param counts: a mapping from names to counts
        :returns: a mapping from the same names to rates
        """
        now = time.monotonic()
        elapsed = max(now - self._counted_at, 1e-9)
        rates = {k: (v - self._counts.get(k, 0)) / elapsed for k, v in counts.items()}
        self._counts, self._counted_at = dict(counts), now
        return rates

    def report(self) -> None:
        """Publish and log the state of the node."""
        level, message, values = self._assess()
        if conflicts := self._node.publisher_conflicts():
            # DDS takes some 20 s to notice that a process was killed.
            level = max(level, WARN)
            message += (f'; more than one publisher on {", ".join(conflicts)}: two nodes where '
                        'one is right, or one that died within the last 20 s')
            values = {**values, 'publisher conflicts': len(conflicts)}
        if self.exceptions:
            values = {**values, 'exceptions': self.exceptions}
            if self.exceptions > self._exceptions_told:
                self._exceptions_told = self.exceptions
                level = max(level, WARN)
                message += f'; survived {self._last_exception}'
        news = self.rejected - self._logged
        if news:
            self._logged = Counter(self.rejected)
            level = max(level, WARN)
            dropped = ', '.join(f'{count} {reason}' for reason, count in news.items())
            message = f'{message}; dropped: {dropped}'
        self.message = message
        self._log(level, message, news)
        self._level = level
        values = {**values, 'rejected': self.rejected.total(),
                  **{f'rejected: {reason}': n for reason, n in self.rejected.items()}}
        status = DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name(),
            hardware_id=self._node.get_name(),
            message=message,
            values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _log(self, level: bytes, message: str, news: Counter[str]) -> None:
        """Log what has changed; rclpy wants each severity to have a line of its own."""
        logger = self._node.get_logger()
        if level == OK:
            if self._level != OK:
                logger.info(f'recovered: {message}')
        elif news or level != self._level:
            if level == WARN:
                logger.warning(message)
            else:
                logger.error(message)


def _text(value: object) -> str:
    """Return a figure as text that a person can read and a program can parse."""
    return f'{value:.6g}' if isinstance(value, float) else str(value)
