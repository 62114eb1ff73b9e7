# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The command line: ``tetra X``, ``ros2 run tetra_ros2 X`` and ``python -m tetra_ros2 X``.

A command is loaded when it is called for, and ROS not before its arguments have been understood.
"""

import argparse
import json
import sys

from tetra_ros2.commands import analyze, plot
from tetra_ros2.paper import figures, verify
from tetra_ros2.study import montecarlo as study


class _Parser(argparse.ArgumentParser):
    """A parser whose messages have the form of all others of this package."""

    def error(self, message):
        """Say what is wrong in one line, and exit with status 2."""
        self.exit(2, f'tetra: error: {message}; see {self.prog} --help\n')


def _add_config(parser):
    parser.add_argument(
        '--config', metavar='FILE',
        help='a ROS 2 parameter file, or the name of one that ships: complete, rotating, '
             'octahedron')


def _add_namespace(parser):
    parser.add_argument('--namespace', metavar='NS', default='', help='namespace of the node')


def _agent_arguments(parser):
    parser.add_argument('--id', type=int, required=True, metavar='I', help='which agent, from 1')
    _add_config(parser)
    _add_namespace(parser)


def _agent(arguments, config, ros):
    from tetra_ros2.nodes import agent
    return agent.main(arguments.id, config, ros)


def _node_arguments(parser):
    _add_config(parser)
    _add_namespace(parser)


def _plant(_arguments, config, ros):
    from tetra_ros2.nodes import plant
    return plant.main(config, ros)


def _monitor(_arguments, config, ros):
    from tetra_ros2.nodes import monitor
    return monitor.main(config, ros)


def _recorder_arguments(parser):
    parser.add_argument(
        'topics', nargs='*', metavar='TOPIC',
        help='topics to record (default: all topics of the formation in this namespace)')
    parser.add_argument('--regex', metavar='R', help='and those whose full names match this')
    parser.add_argument(
        '-o', '--output', metavar='DIR',
        help='directory to make and record into (default: tetra_ and the date)')
    parser.add_argument(
        '--storage', choices=('mcap', 'sqlite3'), help='storage format (default: mcap)')
    parser.add_argument(
        '--use-sim-time', action='store_true', default=None,
        help='file the messages under the time of /clock, as a plant in lockstep publishes it')
    _add_config(parser)
    _add_namespace(parser)


def _recorder(arguments, config, ros):
    from tetra_ros2.recording import recorder
    for name in ('topics', 'regex', 'output', 'storage', 'use_sim_time'):
        if value := getattr(arguments, name):
            ros = [*ros, '-p', f'{name}:={json.dumps(value)}']
    return recorder.main(config, ros)


def _launcher_arguments(parser):
    _add_config(parser)
    parser.set_defaults(config='complete')
    parser.add_argument(
        '--duration', type=float, metavar='S',
        help='formation time to run [s] (default: 30; with --view until Ctrl-C)')
    parser.add_argument(
        '--mode', choices=('lockstep', 'realtime'), help='how time passes (default: as in FILE)')
    parser.add_argument(
        '--seed', type=int, metavar='N', help='of the initial attitudes (default: as in FILE)')
    parser.add_argument(
        '--record', metavar='DIR', help='record into this directory, which must not exist')
    parser.add_argument(
        '--storage', choices=('mcap', 'sqlite3'), default='mcap',
        help='storage format of the recording (default: %(default)s)')
    parser.add_argument(
        '--without', action='append', default=[], metavar='NODE',
        help="leave out plant or agent_I, for somebody else's in its place")
    parser.add_argument(
        '--view', action='store_true',
        help='show it in a browser, at the pace of real time, until Ctrl-C')
    _add_web(parser)
    parser.add_argument('--json', action='store_true', help='print the summary as JSON')
    parser.add_argument('--quiet', action='store_true', help='show no progress')
    _add_namespace(parser)


def _launcher(arguments, config, ros):
    from tetra_ros2.commands import launcher as report
    return report.main(arguments, config, ros)


def _viewer_arguments(parser):
    _add_web(parser)
    parser.add_argument(
        '--bag', metavar='DIR', help='show this recording, with a time slider, and no ROS')
    _add_config(parser)
    _add_namespace(parser)


def _add_web(parser):
    parser.add_argument(
        '--host', metavar='ADDRESS', default='127.0.0.1',
        help='address to listen on; 0.0.0.0 lets other machines look (default: %(default)s)')
    parser.add_argument(
        '--port', type=int, default=8080, metavar='P',
        help='port to listen on; 0 for any that is free (default: %(default)s)')


def _viewer(arguments, config, ros):
    if arguments.bag is not None:
        from tetra_ros2.viewer import replay
        return replay.run(arguments)
    from tetra_ros2.viewer import node as viewer
    return viewer.main(arguments.host, arguments.port, config, ros)


COMMANDS = {
    'agent': (_agent_arguments, _agent, 'one agent'),
    'plant': (_node_arguments, _plant, 'the rigid bodies, or a stand-in for the real ones'),
    'monitor': (_node_arguments, _monitor, 'watch the formation and publish its error'),
    'recorder': (_recorder_arguments, _recorder, 'record the formation into a rosbag2 directory'),
    'launcher': (_launcher_arguments, _launcher, 'all of them in one process, and a summary'),
    'viewer': (_viewer_arguments, _viewer, 'show the formation, or a recording, in a browser'),
}

TOOLS = {
    'plot': (plot, 'write the figures of a recording'),
    'verify': (verify, 'check every claim of the paper'),
    'analyze': (analyze, 'rates, limits and errors that theory predicts for a configuration'),
    'study': (study, 'follow very many random starts, and say how many form and when'),
    'figures': (figures, "draw the paper's simulation figures from runs of the nodes"),
}
"""Modules with ``add_arguments(parser)`` and ``run(arguments)``, which import late too."""

INTERRUPTED = 130


def _split(argv):
    """Return the arguments that are ours and those between ``--ros-args`` and ``--``."""
    ours, ros, target = [], [], None
    for argument in argv:
        if argument == '--ros-args':
            target = ros
        elif argument == '--' and target is ros:
            target = None
        else:
            (ours if target is None else target).append(argument)
    return ours, ros


def main(argv=None):
    """
    Run the command line.

    :param argv: the arguments, without the program's name
    :returns: the exit status: 0 if all is well, 1 if a formation did not form, 2 for a wrong call
    """
    ours, ros = _split(sys.argv[1:] if argv is None else argv)
    parser = _Parser(
        prog='tetra', description='Intrinsic formations of reduced attitudes over ROS 2.',
        epilog='"tetra X --help" tells more of X. ROS arguments go after --ros-args.')
    commands = parser.add_subparsers(dest='command', metavar='X', required=True)
    for name, (add_arguments, _, text) in COMMANDS.items():
        sub = commands.add_parser(name, help=text, description=f'{text[0].upper()}{text[1:]}.')
        add_arguments(sub)
    for name, (tool, text) in TOOLS.items():
        sub = commands.add_parser(name, help=text, description=f'{text[0].upper()}{text[1:]}.')
        tool.add_arguments(sub)
    arguments = parser.parse_args(ours)
    try:
        return _run(arguments, ros)
    except KeyboardInterrupt:
        return INTERRUPTED
    except ModuleNotFoundError as error:
        if hint := _INSTALL.get((error.name or '').partition('.')[0]):
            print(f'tetra: error: {error.name} is not installed: {hint}', file=sys.stderr)
            return 2
        raise


_INSTALL = {
    'matplotlib': "pictures need it: pip install 'tetra_ros2[plot]'",
    'rclpy': "source a ROS 2 installation, or without one: pip install 'tetra_ros2[ros]'",
    'diagnostic_msgs': "source a ROS 2 installation; without one: pip install 'tetra_ros2[ros]'",
    'rosbags': 'recordings need it: pip install rosbags',
    'viser': "the viewer needs it: pip install 'tetra_ros2[view]'",
}


def _run(arguments, ros):
    """Run a command; everything that can be checked without ROS is checked before it loads."""
    from tetra_ros2.config import configuration, parameters
    try:
        if arguments.command in TOOLS:
            return TOOLS[arguments.command][0].run(arguments)
        namespace = configuration.check_namespace(arguments.namespace)
        kinds = parameters.PARAMETERS
        if arguments.command != 'launcher':  # a viewer has no parameters of its own
            kinds = [kind for kind in kinds if kind == arguments.command]
        configuration.check_ros_arguments(ros, kinds)
        config = None
        if arguments.config is not None:
            config = configuration.load(arguments.config).path
        if namespace and arguments.command != 'launcher':
            ros = [*ros, '-r', f'__ns:={namespace}']
        return COMMANDS[arguments.command][1](arguments, config, ros)
    except parameters.ConfigurationError as error:
        print(f'tetra: error: {error}', file=sys.stderr)
        return 2


def agent():
    """Run ``tetra agent``."""
    return main(['agent', *sys.argv[1:]])


def plant():
    """Run ``tetra plant``."""
    return main(['plant', *sys.argv[1:]])


def monitor():
    """Run ``tetra monitor``."""
    return main(['monitor', *sys.argv[1:]])


def recorder():
    """Run ``tetra recorder``."""
    return main(['recorder', *sys.argv[1:]])


def launcher():
    """Run ``tetra launcher``."""
    return main(['launcher', *sys.argv[1:]])


def viewer():
    """Run ``tetra viewer``."""
    return main(['viewer', *sys.argv[1:]])
