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

"""Markers show the state they claim to show, and the files for RViz and Foxglove fit them."""

from collections import Counter
import json
from pathlib import Path
import re
import time

from harness import nanoseconds
import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from tetra_ros2.drawing import colors
from tetra_ros2.formation import shapes
from tetra_ros2.launcher import Launcher
from tetra_ros2.ros import markers as markers_module
from visualization_msgs.msg import Marker, MarkerArray
import yaml

CONFIG = Path(__file__).resolve().parents[2] / 'config'


def xyz(point):
    return np.array([point.x, point.y, point.z])


def by_name(array):
    """Return the markers by namespace and id."""
    named = {(m.ns, m.id): m for m in array.markers}
    assert len(named) == len(array.markers), 'namespace and id tell the markers apart'
    return named


def test_markers_show_the_state_of_their_stamp(probe):
    probe.listen_to_attitudes()
    probe.listen(MarkerArray, 'formation/markers')
    with Launcher('rotating', parameters={'real_time_factor': 1.0}) as formation:
        formation.run_for(2.0)
        probe.wait_for(lambda: len(probe.received['formation/markers']) > 20, 'markers')
        probe.wait_for(lambda: probe.stamp() >= nanoseconds(
            probe.received['formation/markers'][-1].markers[0].header.stamp), 'the state')
    states = {nanoseconds(m.header.stamp): np.array([xyz(p.position) for p in m.poses])
              for m in probe.received['formation/attitudes']}
    for array in probe.received['formation/markers'][1:]:
        named = by_name(array)
        gamma = states[nanoseconds(array.markers[0].header.stamp)]
        for marker in array.markers:
            assert marker.header == array.markers[0].header
            assert marker.header.frame_id == 'world'
            assert marker.action == Marker.ADD
            assert nanoseconds(marker.lifetime) == 1_000_000_000
            assert marker.pose.orientation.w == 1.0
            assert marker.color.a > 0.0
        sphere = named['sphere', 0]
        assert (sphere.type, sphere.scale.x) == (Marker.SPHERE, 2.0), 'of radius 1'
        for i in range(1, 5):
            start, end = named['axes', i].points
            assert named['axes', i].type == Marker.ARROW
            np.testing.assert_array_equal(xyz(start), 0.0)
            np.testing.assert_allclose(xyz(end), gamma[i - 1], atol=1e-15)
            label = named['labels', i]
            assert (label.type, label.text) == (Marker.TEXT_VIEW_FACING, f'agent_{i}')
            np.testing.assert_allclose(xyz(label.pose.position), 1.14 * gamma[i - 1])
            color = named['axes', i].color
            np.testing.assert_allclose(
                [color.r, color.g, color.b], colors.unit_rgb(colors.agent(i)), atol=1e-6)
        faces = named['faces', 0]
        assert faces.type == Marker.TRIANGLE_LIST
        corners = Counter(tuple(np.round(xyz(p), 12)) for p in faces.points)
        assert len(faces.points) == 12
        assert set(corners) == {tuple(np.round(g, 12)) for g in gamma}
    trail = by_name(probe.received['formation/markers'][-1])['trails', 2]
    way = np.array([xyz(p) for p in trail.points])
    np.testing.assert_allclose(np.linalg.norm(way, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(way[-1], gamma[1], atol=1e-15)
    assert np.max(np.linalg.norm(np.diff(way, axis=0), axis=1)) < 0.16
    path = np.array([state[1] for state in states.values()])
    nearest = np.linalg.norm(way[:, None] - path[None], axis=-1).min(axis=1)
    assert np.max(nearest) < 0.02, 'it lies where the agent was'


def test_markers_cost_nothing_while_nobody_listens(monkeypatch, probe):
    made = []
    make = markers_module.make_markers
    monkeypatch.setattr(
        markers_module, 'make_markers', lambda *a: made.append(1) or make(*a))
    with Launcher('complete', parameters={'real_time_factor': 2.0}) as formation:
        formation.run_for(1.0)
        assert not made
        probe.listen(MarkerArray, 'formation/markers')
        probe.wait_for(lambda: probe.node.count_publishers('formation/markers'), 'discovery')
        begun = time.monotonic()
        formation.run_for(4.0)
        assert 10 <= len(made) <= 35 * (time.monotonic() - begun) + 5, '30 a second, no more'


@pytest.mark.parametrize('n', [2, 3, 12])
def test_any_number_of_agents_has_markers(n):
    gamma = np.random.default_rng(n).standard_normal((n, 3))
    gamma /= np.linalg.norm(gamma, axis=1, keepdims=True)
    array = markers_module.make_markers(5, gamma, [gamma])
    spaces = Counter(m.ns for m in array.markers)
    assert spaces == {'sphere': 1, 'axes': n, 'labels': n, **({'faces': 1} if n > 2 else {})}
    two = markers_module.make_markers(6, gamma, [gamma[::-1].copy(), gamma])
    assert Counter(m.ns for m in two.markers)['trails'] == n
    for marker in two.markers:
        if marker.ns == 'faces':
            assert len(marker.points) % 3 == 0


def test_a_thousand_agents_are_two_markers():
    gamma = np.random.default_rng(1).standard_normal((1000, 3))
    gamma /= np.linalg.norm(gamma, axis=1, keepdims=True)
    sphere, tips = markers_module.make_markers(5, gamma, [gamma]).markers
    assert (sphere.ns, tips.ns, tips.type) == ('sphere', 'tips', Marker.POINTS)
    np.testing.assert_allclose([xyz(p) for p in tips.points], gamma)


def test_a_reset_does_not_leave_a_trail_across_the_sphere(monkeypatch):
    states = [(k * 33_000_000, shapes.TETRAHEDRON.points) for k in range(5)]
    states.append((5 * 33_000_000, -shapes.TETRAHEDRON.points))
    made = []

    class Publisher:

        publish = made.append

        @staticmethod
        def get_subscription_count():
            return 1

    class Node:

        def create_publisher(self, *_, **__):
            return Publisher

        def create_steady_timer(self, *_):
            pass

    markers = markers_module.Markers(Node(), lambda: states.pop(0))
    while states:
        markers.refresh()
    spaces = [{m.ns for m in array.markers} for array in made]
    assert 'trails' in spaces[-2]
    assert 'trails' not in spaces[-1], 'there is one position only'


def topics_of(formation):
    return {p.topic_name.lstrip('/') for node in formation.nodes for p in node.outputs} \
        | {'formation/markers', 'formation/bodies'}


def test_the_rviz_file_names_topics_and_namespaces_that_exist():
    document = yaml.safe_load((CONFIG / 'formation.rviz').read_text())
    manager = document['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'world'
    gamma = shapes.TETRAHEDRON.points
    spaces = {m.ns for m in markers_module.make_markers(5, gamma, [gamma, gamma]).markers}
    pytest.importorskip('mujoco')  # without mass there are no bodies to be seen
    with Launcher('complete', body='wheels') as formation:
        topics = topics_of(formation)
        types = {p.topic_name.lstrip('/'): type_name.rsplit('/', 1)[-1]
                 for name, type_names in formation.monitor.get_topic_names_and_types()
                 for type_name in type_names for p in [type('', (), {'topic_name': name})]}
    shown = [d for d in manager['Displays'] if 'Topic' in d]
    assert {d['Topic']['Value'] for d in shown} <= topics
    for display in shown:
        package, kind = display['Class'].split('/')
        assert package == 'rviz_default_plugins'
        assert types[display['Topic']['Value']] == kind, 'a display is named as what it shows'
    markers, = (d for d in shown if d['Topic']['Value'] == 'formation/markers')
    assert set(markers['Namespaces']) == spaces
    assert all(markers['Namespaces'].values())


def panels(tree):
    """Return the ids of the panels in a layout's tree."""
    if isinstance(tree, str):
        return [tree]
    assert tree['direction'] in ('row', 'column')
    assert 0 < tree['splitPercentage'] < 100
    return panels(tree['first']) + panels(tree['second'])


def test_the_foxglove_layout_opens_on_a_recording(tmp_path):
    with Launcher('rotating', record=tmp_path / 'bag') as formation:
        formation.run_for(1.0)
        topics = topics_of(formation)
    with Reader(tmp_path / 'bag') as reader:
        recorded = {c.topic: c for c in reader.connections}
        layout = json.loads((CONFIG / 'foxglove.json').read_text())
        configs = layout['configById']
        assert sorted(panels(layout['layout'])) == sorted(configs)
        kinds = Counter(name.split('!')[0] for name in configs)
        assert kinds == {'3D': 1, 'Plot': 3, 'DiagnosticSummary': 1}
        scene = configs['3D!formation']
        assert scene['followTf'] == 'world'
        assert {t.lstrip('/') for t in scene['topics']} <= topics
        assert '/formation/attitudes' in recorded, 'so that the recording has something to show'
        paths = [p['value'] for c in configs.values() for p in c.get('paths', ())]
        assert len(paths) == 6 + 1 + 4
        for path in paths:
            topic, fields = re.fullmatch(r'(/[\w/]+)\.(.+)', path).groups()
            *_, (connection, _, raw) = reader.messages([recorded[topic]])
            import bags
            value = bags.STORE.deserialize_cdr(raw, connection.msgtype)
            for field in re.findall(r'\w+', fields):
                value = value[int(field)] if field.isdigit() else getattr(value, field)
            assert np.isfinite(value), path
        health = next(c for name, c in configs.items() if name.startswith('Diagnostic'))
        assert health['topicToRender'] == '/diagnostics'
