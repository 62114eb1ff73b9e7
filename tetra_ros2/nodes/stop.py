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

"""The emergency stop of all that there is to stop: the plant, and every driver of a body."""

from collections.abc import Sequence
import math
import re
import sys
import time
from typing import Any

from rclpy.context import Context
from rclpy.node import Node
from std_srvs.srv import SetBool
from tetra_ros2.ros import executor, ports

PATIENCE = 10.0
"""
How long to look for services, and to wait for their answers [s]: who wants to stop has a reason,
and a busy machine may take seconds to discover what there is.
"""

ASK_AGAIN = 1.0
"""
How long to wait for an answer before asking again [s]: a server that has not discovered by then
who asks drops its answer.
"""

SETTLED = 1.0
"""How long no new service may have turned up before that is taken to be all of them [s]."""


def main(data: bool, namespace: str = '', arguments: Sequence[str] = ()) -> int:
    """
    Stop all bodies, or release them.

    :param data: whether to stop
    :param namespace: of the formation, ``/a/b``, or nothing
    :param arguments: arguments as after ``--ros-args``
    :returns: 0 if there were any and all of them answered, otherwise 1
    """
    executor.local_by_default()
    executor.look_around()
    context = Context()
    executor.initialize(context, ['--ros-args', *arguments])
    node = Node('stop', context=context, namespace=namespace or None, use_global_arguments=True)
    ports.reopen_lost(new=True)
    spinner = executor.make_executor(context)
    spinner.add_node(node)
    pattern = re.compile(re.escape(namespace) + r'/(plant|body_\d+)/stop')
    asked: dict[str, list[Any]] = {}  # futures of the answers
    asked_at: dict[str, float] = {}
    clients = {}

    def answer(name: str) -> Any:
        """Return the answer of a service, or None if there is none yet."""
        return next((future.result() for future in asked.get(name, ()) if future.done()), None)

    try:
        begun = last = time.monotonic()
        while (now := time.monotonic()) - begun < PATIENCE:
            for name, types in node.get_service_names_and_types():
                if name not in clients and pattern.fullmatch(name) \
                        and 'std_srvs/srv/SetBool' in types:
                    clients[name] = node.create_client(SetBool, name)
                    last = now
            for name, client in clients.items():
                if client.service_is_ready() and answer(name) is None \
                        and now - asked_at.get(name, -math.inf) > ASK_AGAIN:
                    asked.setdefault(name, []).append(
                        client.call_async(SetBool.Request(data=data)))
                    asked_at[name] = now
            answered = all(answer(name) is not None for name in clients)
            if clients and answered and now - last > SETTLED:
                break
            ports.reopen_lost()
            spinner.spin_once(timeout_sec=0.02)
        missed = 0
        for name in sorted(clients):
            response = answer(name)
            done = response is not None and response.success
            missed += not done
            print(f'{name}: {response.message if done else "no answer"}')
        if not clients:
            print('tetra: error: there is nothing to stop: no plant and no body was found',
                  file=sys.stderr)
        return int(missed > 0 or not clients)
    finally:
        executor.leave(spinner)
