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

import os
from xml.etree import ElementTree

from harness import until
import pytest
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Empty
from tetra_ros2.ros import fastdds
from tetra_ros2.ros.executor import leave


@pytest.fixture(autouse=True)
def unset(monkeypatch, tmp_path):
    monkeypatch.setenv(fastdds.VARIABLE, '')  # so that it is restored
    monkeypatch.delenv(fastdds.VARIABLE)
    monkeypatch.chdir(tmp_path)


def test_the_profile_is_that_of_the_package():
    fastdds.load_profiles()
    root = ElementTree.parse(os.environ[fastdds.VARIABLE]).getroot()
    (writer,) = root
    assert writer.tag.endswith('data_writer')
    assert writer.get('is_default_profile') == 'true'


def test_a_user_who_has_profiles_keeps_them(monkeypatch):
    monkeypatch.setenv(fastdds.VARIABLE, 'mine.xml')
    fastdds.load_profiles()
    assert os.environ[fastdds.VARIABLE] == 'mine.xml'


def test_profiles_in_the_working_directory_are_the_users():
    fastdds.LOCAL.write_text('<profiles/>')
    fastdds.load_profiles()
    assert fastdds.VARIABLE not in os.environ


@pytest.fixture
def make_node():
    """Give what makes a node in a context, and with it a participant, of its own."""
    executors = []

    def make(name):
        context = Context()
        context.init()
        executor = SingleThreadedExecutor(context=context)
        executors.append(executor)
        node = Node(name, context=context)
        executor.add_node(node)
        return node

    yield make
    for executor in executors:
        leave(executor)


def test_a_context_that_has_stopped_listening_is_told_of_nobody(make_node):
    listening, leaving, coming = map(make_node, ('listening', 'leaving', 'coming'))
    coming.create_publisher(Empty, 'before', 1)
    for node in (listening, leaving):
        until(lambda node=node: node.count_publishers('before') == 1)
    assert fastdds.stop_listening(leaving)
    assert fastdds.stop_listening(leaving), 'once more does no harm'
    coming.create_publisher(Empty, 'after', 1)
    until(lambda: listening.count_publishers('after') == 1)
    assert leaving.count_publishers('after') == 0
    leaving.create_publisher(Empty, 'own', 1)
    until(lambda: listening.count_publishers('own') == 1)


@pytest.mark.parametrize('name', ['_RCL', '_RMW', '_FASTDDS', '_GET_PARTICIPANT', '_SET_LISTENER'])
def test_another_middleware_or_another_version_is_left_alone(make_node, monkeypatch, name):
    monkeypatch.setattr(fastdds, name, 'libanother.so')
    assert not fastdds.stop_listening(make_node('somebody'))


def test_a_node_that_is_gone_is_left_alone(make_node):
    node = make_node('gone')
    node.destroy_node()
    assert not fastdds.stop_listening(node)
