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

"""The figures: they are drawn, from runs of the nodes, or nothing is left behind."""

import pytest
from tetra_ros2.cli import main
from tetra_ros2.paper import figures


def test_both_figures_come_in_three_formats_and_with_the_numbers(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(figures, 'DURATIONS', {
        ('complete', 0): 8.0, ('complete', 1): 30.0, ('rotating', 0): 12.0, ('rotating', 1): 45.0})
    assert main(['figures', '--out', str(tmp_path / 'new'), '--rate', '20']) == 0
    assert {path.name for path in (tmp_path / 'new').iterdir()} == {
        f'{name}.{suffix}' for name in ('stationary', 'rotating')
        for suffix in ('pdf', 'png', 'svg')}
    assert all(path.stat().st_size > 10000 for path in (tmp_path / 'new').iterdir())
    lines = capfd.readouterr().out.splitlines()
    assert len(lines) == 4
    assert all('measured' in line for line in lines)


@pytest.mark.parametrize('arguments', [
    ['--out', '/proc/nowhere'], ['--out', 'x', '--seed', '-1'], ['--out', 'x', '--rate', '0']])
def test_wrong_calls_are_refused(arguments, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['figures', *arguments]) == 2
    assert capsys.readouterr().err.startswith('tetra: error: --')
    assert not list(tmp_path.iterdir())
