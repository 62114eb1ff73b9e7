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

"""Every file says whose it is and under which licence, as ``ament_copyright`` has it."""

from pathlib import Path
import re

import pytest

TOP = Path(__file__).resolve().parents[1]
OURS = ('tetra_ros2', 'benchmarks', 'docs', 'examples', 'launch', 'scripts', 'test')


@pytest.mark.linter
@pytest.mark.copyright
def test_ament_copyright_finds_no_fault(monkeypatch):
    linter = pytest.importorskip('ament_copyright.main', reason='it comes with ROS 2 from apt')
    monkeypatch.chdir(TOP)
    assert linter.main(argv=['setup.py', *(part for part in OURS if Path(part).exists())]) == 0


def test_every_file_says_whose_it_is_and_under_which_licence():
    _, terms = Path(__file__).read_text(encoding='utf-8').split('\n', 1)
    terms = terms[:terms.index('\n\n') + 1]
    assert terms.startswith('#\n# Licensed under the Apache License, Version 2.0')
    files = [TOP / 'setup.py', *(
        file for part in OURS for file in (TOP / part).rglob('*')
        if file.suffix == '.py' or (file.parent.name == 'scripts' and file.is_file()))]
    assert len(files) > 100
    for file in files:
        text = re.sub(r'\A#!.*\n', '', file.read_text(encoding='utf-8'))
        assert re.match(r'# Copyright \d{4} \S.*\n' + re.escape(terms), text), file
