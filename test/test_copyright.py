# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""What ``ament_copyright`` says of the tree, where there is ament."""

from pathlib import Path
import re

import pytest

TOP = Path(__file__).resolve().parents[1]
OURS = ('tetra_ros2', 'benchmarks', 'docs', 'examples', 'launch', 'scripts', 'test')


@pytest.mark.linter
@pytest.mark.copyright
def test_ament_copyright_finds_no_fault(monkeypatch):
    linter = pytest.importorskip('ament_copyright.main', reason='it comes with ROS 2 from apt')
    from ament_copyright import parser
    from ament_copyright.licenses import apache2
    # It knows the licence by the thirteen lines of its appendix only; here two do, as SPDX has it.
    ours = apache2._replace(file_headers=['{copyright}\nSPDX-License-Identifier: Apache-2.0'])
    for module in (linter, parser):
        monkeypatch.setattr(module, 'get_licenses', lambda: {'apache2': ours})
    monkeypatch.chdir(TOP)
    assert linter.main(argv=['setup.py', *(part for part in OURS if Path(part).exists())]) == 0


def test_every_file_says_whose_it_is_and_under_which_licence():
    files = [TOP / 'setup.py', *(
        file for part in OURS for file in (TOP / part).rglob('*')
        if file.suffix == '.py' or (file.parent.name == 'scripts' and file.is_file()))]
    assert len(files) > 100
    for file in files:
        lines = [line for line in file.read_text(encoding='utf-8').splitlines()
                 if not line.startswith('#!')]
        assert re.fullmatch(r'# Copyright \d{4} \S.*', lines[0]), file
        assert lines[1] == '# SPDX-License-Identifier: Apache-2.0', file
