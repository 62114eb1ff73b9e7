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

"""Choosing claims of the paper, and checking them."""

from collections.abc import Callable, Iterable
import time
from typing import NamedTuple

from tetra_ros2.config.parameters import ConfigurationError, nearest
from tetra_ros2.paper import claims, errata  # noqa: F401, they register themselves
from tetra_ros2.paper.registry import Claim, CLAIMS, Result
from tetra_ros2.paper.system import SystemUnderTest


class Row(NamedTuple):
    """
    A claim that has been checked.

    :param claim: the claim
    :param result: what came of it
    :param seconds: how long that took [s]
    """

    claim: Claim
    result: Result
    seconds: float


def select(keys: Iterable[str] = (), without_nodes: bool = False) -> list[Claim]:
    """
    Return the claims of the given keys, or all, in the paper's order.

    :raises ConfigurationError: if there is no claim of such a key
    """
    keys = list(dict.fromkeys(keys))
    for key in keys:
        if key not in CLAIMS:
            raise ConfigurationError(
                f'there is no claim {key!r}{nearest(key, CLAIMS)}; see tetra verify --list')
    return [CLAIMS[key] for key in keys or CLAIMS
            if not (without_nodes and CLAIMS[key].nodes)]


def check(chosen: Iterable[Claim], system: SystemUnderTest,
          progress: Callable[[Claim | None], None] = lambda claim: None) -> list[Row]:
    """
    Check claims.

    :param chosen: the claims
    :param system: what to test them on
    :param progress: called with each claim before it is checked, and with None at the end
    """
    rows = []
    try:
        for claim in chosen:
            progress(claim)
            begun = time.perf_counter()
            result = claim.check(system)
            rows.append(Row(claim, result, time.perf_counter() - begun))
    finally:
        progress(None)
    return rows
