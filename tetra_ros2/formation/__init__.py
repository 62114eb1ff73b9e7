# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The mathematics of intrinsic formations of reduced attitudes; no ROS in here.

``sphere`` and ``rotation`` are the geometry, ``gain`` and ``topology`` the two things a user
chooses, ``law`` what they make every body do, ``measures`` and ``shapes`` what comes of it. These
work on numpy arrays of shape ``(..., n, 3)``: one formation, or a million. ``controller`` and
``bodies`` are the two halves of the running loop, one agent and the plant, in plain floats: on
3-vectors numpy costs more than the arithmetic. ``simulation`` closes the loop without a network,
in either form.

Equation, lemma and theorem names are those of Zhang, Song, He, Hong, Hu, *Intrinsic Tetrahedron
Formation of Reduced Attitude*.
"""
