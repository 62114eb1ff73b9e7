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

"""Packaging for colcon (ament_python) and for pip."""

from pathlib import Path
import runpy
import sys

from setuptools import find_packages, setup

package_name = 'tetra_ros2'
share = f'share/{package_name}'

# `ros2 run tetra_ros2 X` runs lib/tetra_ros2/X, which colcon and the Debian build make of a script
# X. A wheel has `tetra X` instead: nobody wants a command `plant` in ~/bin. They are no entry
# points: what setuptools makes of these loads for a tenth of a second before it comes to us.
wheel = {'bdist_wheel', 'dist_info', 'editable_wheel'}.intersection(sys.argv)
scripts = [] if wheel else sorted(map(str, Path('scripts').iterdir()))

extras = dict(runpy.run_path(f'{package_name}/installation.py')['EXTRAS'])
extras['all'] = [package for name in extras if name != 'ros' for package in extras[name]]
extras['test'] = [
    *extras['all'],
    'colcon-bash',
    'colcon-core',
    'colcon-library-path',
    'colcon-recursive-crawl',
    'colcon-ros',
    'colcon-test-result',
    'furo',
    'hypothesis',
    'ipykernel',
    'lxml',
    'mcap',
    'mcap-ros2-support',
    'mypy',
    'myst-parser',
    'nbclient',
    'playwright',
    'pytest',
    'pytest-timeout',
    'pytest-xdist',
    'ruff',
    'setuptools',
    'sphinx',
    'sphinx-copybutton',
    'types-PyYAML',
]

setup(
    name=package_name,
    version='0.1.0',
    description='Intrinsic tetrahedron formation of reduced attitudes over ROS 2',
    long_description=Path('README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    # Whoever releases puts a name and an address here that people can write to; package.xml too.
    maintainer='The tetra_ros2 authors',
    maintainer_email='maintainers@tetra-ros2.example.org',
    license='Apache-2.0',
    packages=find_packages(include=[package_name, f'{package_name}.*']),
    package_data={package_name: ['py.typed', 'ros/fastdds.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (share, ['package.xml']),
        (f'{share}/config', sorted(map(str, Path('config').iterdir()))),
        (f'{share}/launch', sorted(map(str, Path('launch').glob('*.launch.py')))),
    ],
    python_requires='>=3.10',
    install_requires=['numpy', 'PyYAML', 'rich'],
    extras_require=extras,
    zip_safe=False,
    entry_points={'console_scripts': ['tetra = tetra_ros2.cli:main']},
    scripts=scripts,
)
