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

"""Recordings become arrays, or one clear line that says why not."""

import bags
import numpy as np
import pytest
from rosbags.rosbag2 import Writer
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation import rotation, topology
from tetra_ros2.recording import reader as recording


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_recording_is_read_as_it_was_written(tmp_path, storage):
    graph = topology.rotating()
    attitudes, rates = bags.write(tmp_path / 'bag', 50, graph, storage=storage)
    loaded = recording.load(tmp_path / 'bag')
    assert loaded.namespace == '/'
    assert loaded.dropped == 0
    np.testing.assert_array_equal(loaded.attitudes, attitudes)
    np.testing.assert_allclose(loaded.gamma, rotation.rotate(attitudes, [1.0, 0.0, 0.0]))
    np.testing.assert_allclose(loaded.times, 0.01 * np.arange(50), atol=1e-9)
    assert loaded.edges == tuple((i, j) for i, j, _ in graph.edges)
    for i in range(1, 5):
        np.testing.assert_array_equal(loaded.answers(i), rates[:, i - 1])
        np.testing.assert_allclose(loaded.ages(i)[1:], 0.01, atol=1e-12)
        assert np.isnan(loaded.ages(i)[0])


def test_states_that_come_again_or_are_no_directions_are_not_used(tmp_path):
    good = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], 3)
    states = [(1, good), (2, good), (2, good), (3, 1.1 * good), (4, np.nan * good), (5, good)]
    with Writer(tmp_path / 'bag', version=9) as bag:
        topic = bag.add_connection('/formation/attitudes', bags.POSES, typestore=bags.STORE)
        for arrived, (second, poses) in enumerate(states):
            bag.write(topic, arrived, bags.message(second * 10**9, 'world', poses, 3))
        bag.write(topic, 9, b'\0\1\0\0rubbish')
        bag.write(topic, 9, bags.message(6 * 10**9, 'moon', good, 3))
    loaded = recording.load(tmp_path / 'bag')
    assert (loaded.stamps // 10**9).tolist() == [1, 2, 5]
    assert loaded.dropped == 5


def test_of_a_plant_that_was_started_again_the_longest_run_is_taken(tmp_path):
    poses = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], 2)
    with Writer(tmp_path / 'bag', version=9) as bag:
        topic = bag.add_connection('/formation/attitudes', bags.POSES, typestore=bags.STORE)
        for arrived, second in enumerate([7, 8, 1, 2, 3, 4]):
            bag.write(topic, arrived, bags.message(second * 10**9, 'world', poses, 2))
    assert (recording.load(tmp_path / 'bag').stamps // 10**9).tolist() == [1, 2, 3, 4]


def test_of_several_formations_one_has_to_be_named(tmp_path):
    poses = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], 2)
    with Writer(tmp_path / 'bag', version=9) as bag:
        for namespace, count in (('/left', 2), ('/right/inner', 3)):
            topic = bag.add_connection(
                f'{namespace}/formation/attitudes', bags.POSES, typestore=bags.STORE)
            for second in range(1, count + 1):
                bag.write(topic, second, bags.message(second * 10**9, 'world', poses, 2))
    with pytest.raises(ConfigurationError, match='/left, /right/inner'):
        recording.load(tmp_path / 'bag')
    assert len(recording.load(tmp_path / 'bag', 'right/inner').stamps) == 3


def test_a_part_of_a_recording_has_its_own_commands(tmp_path):
    _, rates = bags.write(tmp_path / 'bag', 50)
    part = recording.load(tmp_path / 'bag').between(0.1, 0.2)
    assert len(part.stamps) == 11
    np.testing.assert_array_equal(part.answers(2), rates[10:21, 1])
    with pytest.raises(ConfigurationError, match='less than two states'):
        recording.load(tmp_path / 'bag').between(7.0)


def test_what_is_no_recording_is_refused_in_one_line(tmp_path):
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'file').write_text('x')
    with Writer(tmp_path / 'other', version=9) as bag:
        topic = bag.add_connection('/chatter', bags.VECTOR, typestore=bags.STORE)
        bag.write(topic, 1, bags.message(1, 'a', [1.0, 0.0, 0.0]))
    for name, reason in (('missing', 'no such directory'), ('empty', 'not a rosbag2 directory'),
                         ('file', 'not a rosbag2 directory'), ('other', 'no messages on')):
        with pytest.raises(ConfigurationError, match=reason) as caught:
            recording.load(tmp_path / name)
        assert str(tmp_path / name) in str(caught.value)
        assert '\n' not in str(caught.value)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('kept', [0.0, 0.3, 0.8, 0.99])
def test_a_recording_that_was_cut_off_is_refused_in_one_line(tmp_path, storage, kept):
    bags.write(tmp_path / 'bag', 300, storage=storage)
    file, = (f for f in (tmp_path / 'bag').iterdir() if f.suffix in ('.mcap', '.db3'))
    content = file.read_bytes()
    file.write_bytes(content[:int(kept * len(content))])
    with pytest.raises(ConfigurationError, match=r'damaged or was cut off|holds no') as caught:
        recording.load(tmp_path / 'bag')
    assert '\n' not in str(caught.value)
