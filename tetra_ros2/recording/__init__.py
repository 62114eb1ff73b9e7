# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Recordings: the recorder, the process that writes, the reader, and the figures of one."""
