# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The commands of ``tetra``, one module each.

A module has ``add_arguments(parser)``, which declares its arguments, and ``run(arguments)``, which
returns the exit status. What was given after ``--ros-args`` is in ``arguments.ros_arguments``. A
module is imported when its command is called for. At its top it imports only what the base
installation has: whatever needs ROS or an extra is imported in ``run``, so that ``--help`` and the
check of the arguments work without it.
"""

COMMANDS = {
    'agent': 'one agent',
    'plant': 'the rigid bodies, or a stand-in for the real ones',
    'sensors': 'measure with poses from elsewhere, such as motion capture',
    'body': 'drive a real body',
    'stop': 'emergency stop: hold all bodies until they are released',
    'monitor': 'watch the formation and publish its error',
    'recorder': 'record the formation into a rosbag2 directory',
    'recover': 'make a whole recording of one that was cut off',
    'launcher': 'all of them in one process, and a summary',
    'viewer': 'show the formation, or a recording, in a browser',
    'plot': 'write the figures of a recording',
    'verify': 'check every claim of the paper',
    'analyze': 'rates, limits and errors that theory predicts for a configuration',
    'design': "find weights for a formation of one's own, at rest or turning",
    'study': 'follow very many random starts, and say how many form and when',
    'figures': "draw the paper's simulation figures from runs of the nodes",
}
"""Each command and what it does; the module of command ``x`` is ``tetra_ros2.commands.x``."""
