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

"""
What the nodes here want of Fast DDS otherwise than it comes.

A reliable subscription that has missed a message holds back all later ones until it gets it again.
It learns from a heartbeat of the publisher that there is one to be asked for. Fast DDS sends a
heartbeat every three seconds, and with each message where only the newest is kept. So one lost
state delays the next states by up to three seconds. Here there are two heartbeats a second. Only
a profile in a file can say so: the period is no part of ROS 2's quality of service.

A process that leaves while others do may never end. Before it takes a participant apart, ROS 2 has
Fast DDS tell it no more of who comes and goes; Fast DDS waits, without a limit, until what it is
telling just then has been heard. The library in the wheels was built for an old C library, which
has no clock for such a wait: no limit becomes a time before 1970, the wait fails at once and is
begun again, and the lock that the other thread needs to come to its end is never let go. Of 1,374
nodes, six of which were interrupted at once, two hung so. A wait with a limit does end. So the
nodes here ask Fast DDS for one of their own, before ROS 2 does.
"""

import ctypes
import os
from pathlib import Path

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

PROFILES = Path(__file__).with_suffix('.xml')
"""The profile of this package's publishers."""

VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
"""The environment variable from which Fast DDS 2 takes a file of profiles."""

LOCAL = Path('DEFAULT_FASTRTPS_PROFILES.xml')
"""The file of profiles that Fast DDS takes if it is in the working directory."""

PATIENCE = 10
"""How long Fast DDS may take to tell what it is telling [s]; it takes some microseconds."""

_RCL, _RMW, _FASTDDS = 'librcl.so', 'librmw_fastrtps_cpp.so', 'libfastrtps.so.2.14'
"""The libraries of Jazzy, by the names under which they are loaded."""

_GET_PARTICIPANT = '_ZN16rmw_fastrtps_cpp22get_domain_participantEP10rmw_node_s'
"""``rmw_fastrtps_cpp::get_domain_participant(rmw_node_t *)``."""

_SET_LISTENER = (
    '_ZN8eprosima7fastdds3dds17DomainParticipant12set_listenerE'
    'PNS1_25DomainParticipantListenerENSt6chrono8durationIlSt5ratioILl1ELl1EEEE')
"""``DomainParticipant::set_listener(DomainParticipantListener *, std::chrono::seconds)``."""


def load_profiles() -> None:
    """
    Have Fast DDS take the profile of this package, unless the user has profiles of his own.

    To be called before the process makes its first node. Other implementations of ROS 2's
    middleware do not look at it.
    """
    if not LOCAL.exists():
        os.environ.setdefault(VARIABLE, str(PROFILES))


def stop_listening(node: Node) -> bool:
    """
    Have Fast DDS tell the context of a node no more of who comes and goes.

    To be called once no node of the context needs to know, before the last one is destroyed.
    With another implementation of ROS 2's middleware, this does nothing.

    :param node: any node of the context
    :returns: whether it was done
    """
    try:
        rcl, rmw, library = (
            ctypes.CDLL(name, os.RTLD_NOLOAD) for name in (_RCL, _RMW, _FASTDDS))
        get_node, get_participant, set_listener = (
            rcl.rcl_node_get_rmw_handle, getattr(rmw, _GET_PARTICIPANT),
            getattr(library, _SET_LISTENER))
    except (AttributeError, OSError):  # another middleware, or another version
        return False
    get_node.argtypes = get_participant.argtypes = [ctypes.c_void_p]
    get_node.restype = get_participant.restype = ctypes.c_void_p
    set_listener.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64]
    set_listener.restype = ctypes.c_uint32
    try:
        with node.handle:
            participant = get_participant(get_node(node.handle.pointer))
            return bool(participant) and set_listener(participant, None, PATIENCE) == 0
    except InvalidHandle:  # it was destroyed before
        return False
