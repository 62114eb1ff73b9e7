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

"""Every way to install the package leaves something that runs, and finds its files."""

from email import message_from_string
import os
from pathlib import Path
import subprocess
import sys
from types import ModuleType, SimpleNamespace
import zipfile

import pytest
from tetra_ros2.config.share import share_directory
import yaml

TOP = Path(__file__).resolve().parents[2]
NODES = {'agent', 'plant', 'monitor', 'recorder', 'launcher', 'viewer', 'sensors', 'body'}


def run(*command, **kwargs):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False,
                          **kwargs)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope='module')
def wheel(source, tmp_path_factory):
    target = tmp_path_factory.mktemp('wheel')
    run(sys.executable, '-m', 'pip', 'wheel', '--quiet', '--no-deps', '-w', target, source)
    file, = target.glob('*.whl')
    return file


def test_a_wheel_has_one_command_and_wants_no_ros(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        info = next(name for name in names if name.endswith('.dist-info/METADATA'))
        metadata = message_from_string(archive.read(info).decode())
        entry_points = archive.read(info.replace('METADATA', 'entry_points.txt')).decode()
    assert 'tetra = tetra_ros2.cli:main' in entry_points
    assert 'plant' not in entry_points
    plain = [r for r in metadata.get_all('Requires-Dist') if 'extra ==' not in r]
    assert sorted(r.lower() for r in plain) == ['numpy', 'pyyaml', 'rich']
    assert not any(name.startswith(('test/', 'benchmarks/')) for name in names)


def test_a_wheel_finds_its_files_wherever_it_was_installed(wheel, tmp_path):
    run(sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps', '--target', tmp_path,
        wheel)
    where = run(sys.executable, '-c',
                'from tetra_ros2.config.share import share_directory; print(share_directory())',
                env={**os.environ, 'PYTHONPATH': str(tmp_path)}, cwd=tmp_path).strip()
    assert Path(where) == tmp_path / 'share' / 'tetra_ros2'
    assert {p.name for p in (Path(where) / 'config').iterdir()} >= {
        'complete.yaml', 'rotating.yaml'}
    assert (Path(where) / 'launch' / 'formation.launch.py').is_file()
    run(sys.executable, '-c',
        'from tetra_ros2.config import configuration; configuration.load("rotating")',
        env={**os.environ, 'PYTHONPATH': str(tmp_path)}, cwd=tmp_path)


def test_the_source_tree_finds_its_own_files():
    assert share_directory() == TOP


def test_colcon_builds_what_ros2_run_and_ros2_launch_look_for(workspace):
    prefix = workspace / 'install' / 'tetra_ros2'
    assert (prefix / 'share/ament_index/resource_index/packages/tetra_ros2').is_file()
    share = prefix / 'share' / 'tetra_ros2'
    assert (share / 'package.xml').is_file()
    assert (share / 'launch' / 'formation.launch.py').is_file()
    assert (share / 'config' / 'rotating.yaml').is_file()
    assert {p.name for p in (prefix / 'lib' / 'tetra_ros2').iterdir()} >= NODES


def test_colcon_built_executables_run(workspace):
    script = ('. install/setup.bash && install/tetra_ros2/lib/tetra_ros2/launcher '
              '--config complete --duration 5 --json')
    environment = {k: v for k, v in os.environ.items() if k != 'PYTHONPATH'}
    output = run('bash', '-c', script, cwd=workspace, env=environment)
    assert yaml.safe_load(output)['formed'] is True


def test_colcon_test_runs_these_tests(workspace):
    colcon = Path(sys.executable).with_name('colcon')
    run(colcon, 'test', '--pytest-args', 'test/formation/test_topology.py', cwd=workspace)
    output = run(colcon, 'test-result', '--all', cwd=workspace)
    tests = int(output.split('Summary: ')[1].split()[0])
    assert tests > 10
    assert ' 0 errors, 0 failures' in output


def test_tests_that_want_more_than_rosdep_brings_are_skipped(tmp_path):
    for name in ('mcap', 'matplotlib', 'mujoco', 'playwright', 'pyarrow', 'rosbags', 'viser'):
        (tmp_path / f'{name}.py').write_text(
            f"raise ModuleNotFoundError('No module named {name}', name='{name}')\n")
    output = run(sys.executable, '-m', 'pytest', '--collect-only', '-q', '-p', 'no:cacheprovider',
                 'test', cwd=TOP, env={**os.environ, 'PYTHONPATH': f'{tmp_path}:{TOP}'})
    assert 'error' not in output.splitlines()[-1], output
    assert 'viser is not installed' in output
    assert 'test_gain.py' in output


def test_versions_agree():
    import re
    package = (TOP / 'package.xml').read_text()
    setup = (TOP / 'setup.py').read_text()
    version = re.search('<version>(.*)</version>', package)[1]
    assert f"version='{version}'" in setup
    assert version in (TOP / 'CHANGELOG.md').read_text()


class _Stub(SimpleNamespace):
    """A class of launch, as far as the launch file can tell; it keeps what it was given."""

    def __init__(self, *args, **kwargs):
        super().__init__(args=args, **kwargs)


@pytest.fixture
def launch_file(monkeypatch):
    """
    Return the launch file's module.

    Where launch is not installed, as among the wheels it is not, stand-ins take its place that
    hold what ROS 2 would be asked to start.
    """
    modules = {
        'launch': ['LaunchDescription'],
        'launch.actions': ['DeclareLaunchArgument', 'OpaqueFunction', 'Shutdown'],
        'launch.substitutions': [],
        'launch_ros': [],
        'launch_ros.actions': ['Node'],
    }
    for name, classes in modules.items():
        module = ModuleType(name)
        for cls in classes:
            setattr(module, cls, type(cls, (_Stub,), {}))
        monkeypatch.setitem(sys.modules, name, module)

    class LaunchConfiguration:

        def __init__(self, name):
            self.name = name

        def perform(self, context):
            return context[self.name]

    sys.modules['launch.substitutions'].LaunchConfiguration = LaunchConfiguration
    source = (TOP / 'launch' / 'formation.launch.py').read_text()
    namespace = {}
    exec(compile(source, 'formation.launch.py', 'exec'), namespace)
    return SimpleNamespace(**namespace)


def launched(launch_file, **arguments):
    """Return the nodes that would be started, by executable and arguments."""
    description = launch_file.generate_launch_description()
    declared = {a.args[0]: a.default_value for a in description.args[0]
                if type(a).__name__ == 'DeclareLaunchArgument'}
    function = description.args[0][-1].function
    assert set(arguments) <= set(declared)
    return function({**declared, **arguments})


def test_the_launch_file_starts_a_process_for_every_node(launch_file, tmp_path):
    nodes = launched(launch_file, config='octahedron', namespace='orbit',
                     record=str(tmp_path / 'bag'))
    executables = [node.executable for node in nodes]
    assert sorted(executables) == ['agent'] * 6 + ['monitor', 'plant', 'recorder']
    assert [node.arguments for node in nodes if node.executable == 'agent'] == [
        ['--id', str(i)] for i in range(1, 7)]
    assert {node.namespace for node in nodes} == {'orbit'}
    assert {node.package for node in nodes} == {'tetra_ros2'}
    assert all(Path(node.parameters[0]).name == 'octahedron.yaml' for node in nodes)
    assert set(executables) <= NODES
    recorder, = (node for node in nodes if node.executable == 'recorder')
    assert recorder.arguments == ['--output', str(tmp_path / 'bag')]


def test_the_launch_file_passes_mode_and_seed_to_the_plant_only(launch_file):
    nodes = launched(launch_file, config='rotating', mode='realtime', seed='3')
    for node in nodes:
        expected = {'mode': 'realtime', 'seed': 3}
        assert (node.parameters[1:] == [expected]) == (node.executable == 'plant')


def test_the_launch_file_shows_the_formation_in_rviz_if_told_to(launch_file, monkeypatch):
    monkeypatch.setitem(launch_file.check_rviz.__globals__, 'get_package_share_directory',
                        lambda _: '/opt/ros/jazzy/share/rviz2')
    assert not [n for n in launched(launch_file, config='complete') if n.package == 'rviz2']
    rviz, = (n for n in launched(launch_file, config='complete', namespace='orbit', rviz='true')
             if n.package == 'rviz2')
    assert rviz.namespace == 'orbit', 'the topics in the file are relative'
    option, file = rviz.arguments
    assert option == '-d'
    assert yaml.safe_load(Path(file).read_text())['Visualization Manager']
