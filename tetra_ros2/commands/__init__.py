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
    'policy': 'write the SROS2 policy that follows from a graph',
    'verify': 'check every claim of the paper',
    'analyze': 'rates, limits and errors that theory predicts for a configuration',
    'design': "find weights for a formation of one's own, at rest or turning",
    'study': 'follow very many random starts, and say how many form and when',
    'figures': "draw the paper's simulation figures from runs of the nodes",
    'completion': 'print what lets a shell complete these commands',
}
"""Each command and what it does; the module of command ``x`` is ``tetra_ros2.commands.x``."""

NODES = ('agent', 'plant', 'sensors', 'body', 'monitor', 'recorder', 'viewer')
"""Those that run until a signal ends them, which is then how it should be: exit status 0."""

EXAMPLES = {
    'agent': (
        'tetra agent --id 1 --config rotating',
        'tetra agent --id 2 --config rotating --namespace orbit --ros-args -p gain.a:=2.0',
    ),
    'plant': (
        'tetra plant --config rotating --ros-args -p mode:=realtime -p rate:=50.0',
        'tetra plant --config rotating --namespace orbit',
    ),
    'sensors': (
        'tetra sensors --config rotating',
        "tetra sensors --ros-args -p 'poses.topic:=/vrpn_mocap/{name}/pose'",
    ),
    'body': (
        'tetra body --id 1 --driver pan_tilt --option port=/dev/ttyUSB0',
        'tetra body --id 2 --driver my_package.gimbal:Gimbal --option speed=2.5',
        'tetra body --id 3 --driver rate_setpoint',
    ),
    'stop': (
        'tetra stop',
        'tetra stop --release',
    ),
    'monitor': (
        'tetra monitor --config rotating',
        'tetra monitor --config rotating --ros-args -p tolerance:=0.01',
    ),
    'recorder': (
        'tetra recorder --output bag',
        'tetra recorder -o bag --storage sqlite3 --regex "/rosout"',
        'tetra recorder -o bag formation/attitudes formation/error',
    ),
    'recover': (
        'tetra recover bag',
        'tetra recover bag --output whole',
    ),
    'launcher': (
        'tetra launcher --config rotating',
        'tetra launcher --config rotating --seed 3 --duration 20 --record bag',
        'tetra launcher --config rotating --view',
        'tetra launcher --config rotating --body wheels',
        'tetra launcher --config complete --json --quiet --ros-args -p gain.a:=2.0',
        'tetra launcher --without agent_3     # which you start yourself',
    ),
    'viewer': (
        'tetra viewer',
        'tetra viewer --namespace orbit --port 9000',
        'tetra viewer --bag bag',
    ),
    'plot': (
        'tetra plot bag --out figures',
        'tetra plot bag --out figures --only error rates --format svg --to 10',
        'tetra plot bag --out figures --movie',
    ),
    'verify': (
        'tetra verify',
        'tetra verify --list',
        'tetra verify --json > claims.json',
    ),
    'policy': (
        'tetra policy --config rotating --output policy.xml',
    ),
    'analyze': (
        'tetra analyze --config complete',
        'tetra analyze --config rotating --json',
        'tetra analyze --config rotating --body wheels --bandwidth 20',
    ),
    'design': (
        'tetra design --polyhedron cube --out cube.yaml',
        'tetra design --polyhedron octahedron --spin 0 0 0.2 --max-degree 4',
    ),
    'study': (
        'tetra study --starts 10000 --out study',
        'tetra study --starts 10000 --out study --resume',
    ),
    'figures': (
        'tetra figures --out figures',
        'tetra figures --out figures --seed 3 --rate 50',
    ),
    'completion': (
        'eval "$(tetra completion bash)"      # or put this line into ~/.bashrc',
        'tetra completion fish > ~/.config/fish/completions/tetra.fish',
    ),
}
"""Calls of each command that work as they stand; a test makes the parser read them."""
