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

"""How ``make docs`` builds the documentation, with Sphinx."""

from pathlib import Path
import re
import sys

TOP = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TOP))

project = 'tetra_ros2'
author = 'The tetra_ros2 authors'
copyright = f'2026, {author}'  # noqa: A001
release = re.search('<version>(.*)</version>', (TOP / 'package.xml').read_text())[1]

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.viewcode',
    'sphinx_copybutton',
]
myst_enable_extensions = ['dollarmath', 'colon_fence']
myst_heading_anchors = 3
# No formula needs a script from elsewhere: MathML is drawn by the browser itself.
html_theme = 'furo'
html_title = f'tetra_ros2 {release}'
html_extra_path = ['formation.html']
exclude_patterns = ['_build']

autodoc_member_order = 'bysource'
autodoc_typehints = 'description'
autodoc_typehints_description_target = 'documented'
# Whoever builds the documentation need not have ROS.
autodoc_mock_imports = [
    'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'rcl_interfaces', 'rclpy',
    'rosgraph_msgs', 'rosidl_runtime_py', 'sensor_msgs', 'std_msgs', 'std_srvs',
    'visualization_msgs']

# The documentation must build where only the package registries can be reached.
linkcheck_ignore = ['https?://.*']
