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
Whether processes that leave at once all end: ``python -m benchmarks.leaving``.

Why they may not is in :mod:`tetra_ros2.ros.fastdds`. With ``--plain`` they leave as rclpy has it.
"""

import argparse
import multiprocessing
import os
import time

from benchmarks.domain import reserved
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Empty
from tetra_ros2.ros.executor import leave

TOPICS = 30
"""How many topics each publishes, and how many of another it is subscribed to."""

SETTLED = 1.0
"""How long all have to find each other before they leave [s]."""

PATIENCE = 20.0
"""How long one may take to leave [s]; it takes a tenth of a second where nobody else works."""


def come_and_go(i: int, n: int, plain: bool, all_are_here) -> None:
    """Be one of n processes with a node each, until all leave."""
    context = Context()
    context.init()
    node = Node(f'leaving_{i}', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    for k in range(TOPICS):
        node.create_publisher(Empty, f'topic_{i}_{k}', 1)
        node.create_subscription(Empty, f'topic_{(i + 1) % n}_{k}', lambda _: None, 1)
    all_are_here.wait()
    time.sleep(SETTLED)
    if plain:
        node.destroy_node()
        context.try_shutdown()
    else:
        leave(executor)


def leave_together(n: int, plain: bool) -> int:
    """Have n processes come and leave at once; return how many did not end, and end them."""
    # Forked, as they share then what is imported, and can be many.
    system = multiprocessing.get_context('fork')
    all_are_here = system.Barrier(n + 1)
    processes = [system.Process(target=come_and_go, args=(i, n, plain, all_are_here))
                 for i in range(n)]
    for process in processes:
        process.start()
    all_are_here.wait()
    end = time.monotonic() + SETTLED + PATIENCE
    hung = 0
    for process in processes:
        process.join(max(0.0, end - time.monotonic()))
        if process.is_alive():
            hung += 1
            process.kill()
            process.join()
        elif process.exitcode:
            raise RuntimeError(f'exit status {process.exitcode}')
    return hung


def main() -> None:
    """Count, and print a line."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.leaving', description=__doc__)
    parser.add_argument('--rounds', type=int, default=50, metavar='N',
                        help='how often (default: %(default)s)')
    parser.add_argument('--processes', type=int, default=12, metavar='N',
                        help='how many at once (default: %(default)s)')
    parser.add_argument('--plain', action='store_true', help='leave as rclpy has it')
    arguments = parser.parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    with reserved() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        hung = sum(leave_together(arguments.processes, arguments.plain)
                   for _ in range(arguments.rounds))
    print(f'{hung} of {arguments.rounds * arguments.processes} processes did not end')


if __name__ == '__main__':
    main()
