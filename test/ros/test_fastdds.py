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

import pytest
from tetra_ros2.ros import fastdds


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
