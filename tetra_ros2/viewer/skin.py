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

"""What of viser's page is made otherwise: its title, and its layout on a phone."""

TITLE = 'tetra_ros2'

# What has no class of its own that stays the same is known by its style.
_PANEL = '.mantine-Paper-root[style*="max-height: 60%"]'
_PICTURE = 'div[style^="position: relative; z-index: 0; width: 100%; height: 100%"]:has(canvas)'
_ROW = f'div:has(> {_PANEL})'

_STYLE = f"""<style>
@media (max-width: 36em) {{
  /* The panel stands below the picture, and does not lie over it. */
  {_ROW} {{ flex-direction: column; }}
  {_ROW} > div:has(canvas) {{ height: auto !important; min-height: 0; }}
  {_PANEL} {{
    position: relative !important; flex: none; width: 100% !important;
    max-height: max(45dvh, 100dvh - 100vw) !important;
  }}
  {_PANEL} div[style*="width: 20em"] {{ width: 100% !important; }}
}}
@media (max-aspect-ratio: 1) {{
  /* The eye opens so wide upwards, whatever is left of it sideways: no higher than wide. */
  {_PICTURE} {{ max-height: 100vw; top: 50%; translate: 0 -50%; }}
}}
/* Some lines of the charts are too dark for a dark page. */
[data-mantine-color-scheme="dark"] .uplot {{ filter: brightness(1.7); }}
</style>"""


def dress(page: bytes) -> bytes:
    """Return a page of viser's with the title and the layout of this package."""
    page = page.replace(b'<title>Viser</title>', f'<title>{TITLE}</title>'.encode(), 1)
    return page.replace(b'</head>', f'{_STYLE}</head>'.encode(), 1)
