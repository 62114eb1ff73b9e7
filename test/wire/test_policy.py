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

"""The policy of a formation is well formed, and allows exactly what its nodes do."""

from functools import partial
from pathlib import Path

import pytest
from tetra_ros2.cli import main
from tetra_ros2.formation import topology as topologies
from tetra_ros2.wire.policy import document, rights

etree = pytest.importorskip('lxml.etree')
GRAMMAR = etree.RelaxNG(etree.parse(str(Path(__file__).with_name('policy.rng'))))


@pytest.mark.parametrize('namespace', ['', '/orbit', '/a/b'])
@pytest.mark.parametrize('topology', [
    topologies.complete(), topologies.rotating(), topologies.custom(3, [(1, 2), (2, 1)])],
    ids=['complete', 'rotating', 'custom'])
def test_the_policy_is_one(topology, namespace):
    text = document(rights(topology, namespace), namespace)
    GRAMMAR.assertValid(etree.fromstring(text.encode()))


def test_what_is_no_policy_is_found():
    text = document(rights(topologies.complete()))
    for bad in (text.replace('0.2.0', '0.1.0'), text.replace('ALLOW', 'YES', 1),
                text.replace('<topics publish="ALLOW">', '<topics>', 1)):
        assert not GRAMMAR.validate(etree.fromstring(bad.encode()))


def test_an_agent_may_hear_its_neighbours_and_command_its_own_body_only():
    nodes = rights(topologies.rotating(1, 1))
    assert nodes['agent_2'].subscribe == {
        '/agent_2/relative_attitude/agent_1', '/agent_2/relative_attitude/agent_3'}
    assert {t for t in nodes['agent_2'].publish if 'agent' in t} == {'/agent_2/cmd_vel'}
    assert not nodes['agent_2'].request
    speakers = [name for name, right in nodes.items() if '/agent_1/cmd_vel' in right.publish]
    assert speakers == ['agent_1']


def test_a_monitor_that_publishes_tf_may_do_so(tmp_path, capsys):
    file = tmp_path / 'formation.yaml'
    for wanted in (False, True):
        file.write_text(f'/**:\n  ros__parameters:\n    publish_tf: {str(wanted).lower()}\n')
        assert main(['policy', '--config', str(file)]) == 0
        allowed = etree.fromstring(capsys.readouterr().out.encode()).xpath(
            '//profile[@node="monitor"]/topics[@publish]/topic/text()')
        assert ('/tf' in allowed) == wanted


def test_the_command_writes_it(tmp_path, capsys):
    file = tmp_path / 'policy.xml'
    assert main(['policy', '--config', 'rotating', '--namespace', 'orbit', '--output',
                 str(file)]) == 0
    policy = etree.parse(str(file))
    assert len(policy.findall('.//enclave')) == 8
    assert policy.find('.//profile').get('ns') == '/orbit'
    assert main(['policy', '--output', str(tmp_path / 'nowhere' / 'policy.xml')]) == 2
    assert 'cannot be written' in capsys.readouterr().err


@pytest.mark.parametrize(('namespace', 'body'), [('', 'kinematic'), ('orbit', 'wheels')])
def test_the_nodes_do_what_the_policy_allows_and_nothing_else(tmp_path, namespace, body):
    pytest.importorskip('mujoco')
    launcher = pytest.importorskip('tetra_ros2.launcher')
    pytest.importorskip('viser')
    with launcher.Launcher('rotating', namespace=namespace, body=body, record=tmp_path / 'bag',
                           view=('127.0.0.1', 0)) as formation:
        formation.run_for(0.1)
        allowed = rights(formation.formation.topology, f'/{namespace}' if namespace else '',
                         mass=body != 'kinematic')
        assert {node.get_name() for node in formation.nodes} == set(allowed)
        for node in formation.nodes:
            right = allowed[node.get_name()]
            if node.get_name() == 'viewer':  # the monitor, in the same process, hands it the state
                right.subscribe.discard(node.resolve_topic_name('formation/attitudes'))
            agree(node, right)


def agree(node, right):
    """Fail if a node has opened anything else than it may."""
    opened = {kind: {name for name, _ in getattr(
        node, f'get_{kind}_names_and_types_by_node')(node.get_name(), node.get_namespace())}
        for kind in ('publisher', 'subscriber', 'service', 'client')}
    assert opened['publisher'] == right.publish
    assert opened['subscriber'] == right.subscribe
    assert opened['service'] == right.reply
    assert opened['client'] <= right.request, 'it asks when a person does'


class Still:
    """A driver that does nothing."""

    def apply(self, rate, dt):
        pass


def test_nodes_of_real_bodies_do_what_the_policy_allows_and_nothing_else(tmp_path, probe):
    body = pytest.importorskip('tetra_ros2.nodes.body')
    sensors = pytest.importorskip('tetra_ros2.nodes.sensors')
    bench = pytest.importorskip('node_bench')
    file, output = tmp_path / 'real.yaml', tmp_path / 'policy.xml'
    file.write_text(
        '/body_2:\n  ros__parameters:\n    driver: test_policy:Still\n'
        '/**/sensors:\n  ros__parameters:\n    poses.topic: /vrpn_mocap/{name}/pose\n')
    assert main(['policy', '--config', str(file), '--sensors', '--output', str(output)]) == 0
    policy = etree.parse(str(output))
    GRAMMAR.assertValid(policy)
    assert {profile.get('node') for profile in policy.iter('profile')} == {
        'sensors', 'body_2', 'monitor', 'recorder', 'viewer', *map('agent_{}'.format, range(1, 5))}
    topics = [f'/vrpn_mocap/agent_{i}/pose' for i in range(1, 5)]
    assert set(policy.xpath('//profile[@node="sensors"]/topics[@subscribe]/topic/text()')) == {
        *topics, *(f'/agent_{i}/cmd_vel' for i in range(1, 5))}
    allowed = rights(topologies.complete(), poses=topics, drivers=[2], sensors=True)
    for make, parameters in ((sensors.Sensors, {'poses__topic': '/vrpn_mocap/{name}/pose'}),
                             (partial(body.Body, 2), {'driver': 'test_policy:Still'})):
        with bench.Bench(probe, make, **parameters) as running:
            agree(running.node, allowed[running.node.get_name()])


def test_a_plant_may_hear_the_poses_of_the_bodies_that_are_elsewhere(tmp_path, capsys):
    file = tmp_path / 'formation.yaml'
    for source, expected in (('pose', {'/agent_3/pose'}), ('array', {'/poses'}), ('tf', {'/tf'})):
        file.write_text('/**:\n  ros__parameters:\n    mode: realtime\n    external_bodies: [3]\n'
                        f'    poses.source: {source}\n'
                        + ('    poses.topic: poses\n' if source == 'array' else ''))
        assert main(['policy', '--config', str(file)]) == 0
        heard = etree.fromstring(capsys.readouterr().out.encode()).xpath(
            '//profile[@node="plant"]/topics[@subscribe]/topic/text()')
        assert {topic for topic in heard if 'cmd_vel' not in topic} == expected
