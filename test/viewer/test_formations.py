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

"""Which formations the viewer shows, and what it takes of the machine."""

from pathlib import Path
import socket
import statistics
import time
from types import SimpleNamespace

from browser import charts, shown_time, until, wait_for_server
from harness import interrupt, Probe, run, values
import pytest
from tetra_ros2.viewer.scene import MOST_AGENTS

SLOWLY = ('--ros-args', '-p', 'real_time_factor:=1.0')
"""Arguments of a formation that a page can follow."""

pytestmark = pytest.mark.timeout(300)

def test_it_copes_with_a_plant_that_goes_and_another_that_comes(visit, processes, port):
    viewer = processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    page = visit(port)
    page.get_by_text('waiting').wait_for()
    first = processes.tetra('launcher', '--duration', '1e6', *SLOWLY)
    until(page, lambda: '4 agents, running' in page.inner_text('body'), 'a formation')
    first.kill()
    until(page, lambda: 'is the plant gone?' in page.inner_text('body'), 'the loss is told')
    processes.tetra('launcher', '--config', 'octahedron', '--duration', '1e6', *SLOWLY)
    page.get_by_text('6 agents').wait_for()
    page.get_by_text('agent 6', exact=True).wait_for()
    page.get_by_text('-1.0000, 0.0000').wait_for()  # the cosines of the octahedron
    page.close()
    status_, output = interrupt(viewer)
    assert status_ == 0
    assert f'http://127.0.0.1:{port}' in output
    assert 'Traceback' not in output


def test_somebody_elses_plant_without_agents_parameters_is_shown(visit, processes, port):
    processes.python(Path(__file__).parents[2] / 'examples' / 'own_plant.py')
    processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    page = visit(port)
    page.get_by_text('4 agents').wait_for()
    first = until(page, lambda: shown_time(page), 'a time')
    until(page, lambda: shown_time(page) > first + 1.0, 'time that passes')
    assert len(until(page, lambda: charts(page), 'charts')) == 2
    pause = page.get_by_role('button', name='Pause')
    until(page, pause.is_disabled, 'no service, no button')


def test_a_thousand_states_a_second_make_thirty_pictures(visit, processes, port):
    processes.tetra('launcher', '--mode', 'realtime', '--duration', '1e6', '--ros-args', '-p',
                    'rate:=1000.0')
    processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    page = visit(port)
    until(page, lambda: charts(page), 'charts')

    def busy(health):
        return 'picture rate [Hz]' in (v := values(health)) \
            and float(v['state rate [Hz]']) > 300.0 and float(v['picture rate [Hz]']) > 10.0

    with Probe() as plain:
        plain.wait_for_health('/viewer', busy, 'pictures')

        def rates():
            return [float(values(status)['picture rate [Hz]'])
                    for message in plain.received['diagnostics'] for status in message.status
                    if status.name == '/viewer']

        # A report counts half a second, into which a late picture or two may fall.
        first = len(rates())
        plain.wait_for(lambda: len(rates()) >= first + 6, 'six reports')
    assert statistics.mean(rates()[first:]) < 33.0
    before = charts(page)
    until(page, lambda: charts(page)[0][0][0][-1] > before[0][0][0][-1] + 3.0, 'three seconds')
    assert charts(page)[0][1] == 1, 'nothing was taken away and put back'
    assert charts(page)[1][1] <= 4, 'but for the axis of the error, when it has to go deeper'


def test_a_run_that_has_ended_is_said_to_have(visit, processes, port):
    process = processes.tetra('launcher', '--duration', '1', '--view', '--port', port, '--quiet')
    wait_for_server(port)
    page = visit(port)
    page.get_by_text('the run has ended').wait_for()
    page.close()
    code, output = interrupt(process)
    assert 'Traceback' not in output
    assert code in (0, 1)


def test_a_thousand_agents_take_little_memory_and_no_faces(visit, processes, port):
    script = (
        'import sys, numpy as np, rclpy\n'
        'from geometry_msgs.msg import Pose, PoseArray\n'
        'rclpy.init()\n'
        'node = rclpy.create_node("plant")\n'
        'publisher = node.create_publisher(PoseArray, "formation/attitudes", 1)\n'
        'rng, k = np.random.default_rng(1), 0\n'
        'while True:\n'
        '    k += 1\n'
        '    points = rng.standard_normal((1000, 3))\n'
        '    points /= np.linalg.norm(points, axis=1, keepdims=True)\n'
        '    message = PoseArray()\n'
        '    message.header.frame_id = "world"\n'
        '    message.header.stamp.sec = k\n'
        '    for x, y, z in points.tolist():\n'
        '        pose = Pose()\n'
        '        pose.position.x, pose.position.y, pose.position.z = x, y, z\n'
        '        message.poses.append(pose)\n'
        '    publisher.publish(message)\n'
        '    rclpy.spin_once(node, timeout_sec=0.05)\n')
    viewer = processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    page = visit(port, watch=(received := []))
    before = memory(viewer.pid)
    processes.python('-c', script)
    page.get_by_text('1000 agents').wait_for()
    first = until(page, lambda: shown_time(page), 'a time')
    sent = sum(received)
    last = until(page, lambda: (now := shown_time(page)) > first + 10.0 and now, 'ten states')
    sent = (sum(received) - sent) / (last - first)
    assert f'More than {MOST_AGENTS} agents' in page.inner_text('body')
    assert not charts(page)
    grown = memory(viewer.pid) - before
    print(f'a thousand agents: {grown / 1e6:.0f} MB more, {sent / 1e3:.0f} kB for each state')
    assert grown < 150e6
    assert 0.0 < sent < 40e3, 'three numbers for each direction take 12 kB'


def memory(pid):
    """Return the resident memory of a process [bytes]."""
    return int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * 4096


def test_it_listens_on_this_machine_only_unless_told_otherwise(processes, port):
    processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    listening = [line.split() for table in ('tcp', 'tcp6')
                 for line in Path(f'/proc/net/{table}').read_text().splitlines()[1:]]
    addresses = [fields[1].split(':')[0] for fields in listening
                 if fields[3] == '0A' and int(fields[1].split(':')[1], 16) == port]
    assert addresses == ['0100007F']


@pytest.mark.parametrize('arguments', [['viewer'], ['launcher', '--view']], ids=str)
def test_a_port_in_use_is_refused_in_one_line(arguments):
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        status_, _, errors = run(*arguments, '--port', taken.getsockname()[1])
    assert status_ == 2
    line, = (text for text in errors.splitlines() if 'error' in text)
    assert line.startswith('tetra: error: --port: cannot listen on 127.0.0.1')
    assert 'address already in use' in line


def test_lockstep_with_a_view_is_nearly_as_fast(monkeypatch):
    from tetra_ros2.launcher import Launcher
    from tetra_ros2.viewer import node, panel
    from tetra_ros2.viewer.node import Viewer
    from tetra_ros2.viewer.panel import FRAME_PERIOD, Page
    active = [True]
    refresh, next_at = Viewer._refresh, [0.0]
    # As on a machine of its own, where processor time goes as fast as time does: a busy machine
    # takes longer for the same states, and the viewer would draw more pictures of them.
    for module in (node, panel):
        monkeypatch.setattr(module, 'time', SimpleNamespace(monotonic=time.process_time))

    def draw(self):
        if active[0] and (now := time.process_time()) >= next_at[0]:
            next_at[0] = max(next_at[0], now - FRAME_PERIOD) + FRAME_PERIOD
            refresh(self)

    monkeypatch.setattr(Viewer, '_refresh', draw)
    monkeypatch.setattr(Page, 'watched', True)  # it draws; the browser is on another machine
    with Launcher('rotating', seed=1, view=('127.0.0.1', 0)) as formation:
        formation.run_for(5.0)
        watchers = formation.monitor._watchers[:]

        def measure():
            """Return the processor time with a viewer that draws, of that without."""
            ratios = []
            for k in range(24):
                seconds = {}
                # Each is first as often as the other, as what else there is to do varies.
                for active[0] in ((False, True), (True, False))[k % 2]:
                    formation.monitor._watchers[:] = watchers if active[0] else []
                    begun = time.process_time()
                    formation.run_for(10.0)  # long enough for a picture or two
                    seconds[active[0]] = time.process_time() - begun
                ratios.append(seconds[True] / seconds[False])
            return statistics.median(ratios)

        # On a busy machine what is seldom done finds the caches full of other things, and takes
        # longer. What the viewer takes by itself is in every measurement.
        ratios = [measure()]
        while ratios[-1] >= 1.1 and len(ratios) < 4:
            ratios.append(measure())
    print('processor time with a viewer that draws, of that without:', ratios)
    assert ratios[-1] < 1.1
