# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Bodies with mass, on MuJoCo: reaction wheels, gimbals, and any in a file of one's own."""
