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
Who may do what: the SROS2 policy that follows from a graph.

The graph of a formation says all that its nodes have to say to each other: agent i publishes its
own command and hears the measurements of its neighbours, and nothing else. The form is SROS2's
access control policy, version 0.2.0.
"""

from collections.abc import Collection
from dataclasses import dataclass, field
from xml.etree import ElementTree

from tetra_ros2.formation.topology import Topology
from tetra_ros2.wire import names

VERSION = '0.2.0'

PARAMETER_SERVICES = (
    'describe_parameters', 'get_parameter_types', 'get_parameters', 'get_type_description',
    'list_parameters', 'set_parameters', 'set_parameters_atomically')
"""Services that every node of rclpy offers, relative to its own name."""


@dataclass
class Rights:
    """
    What a node may do; full names.

    :param publish: topics that it may publish on
    :param subscribe: topics that it may hear
    :param reply: services that it may offer
    :param request: services that it may call
    """

    publish: set[str] = field(default_factory=set)
    subscribe: set[str] = field(default_factory=set)
    reply: set[str] = field(default_factory=set)
    request: set[str] = field(default_factory=set)


def rights(topology: Topology, namespace: str = '', *, lockstep: bool = True,
           mass: bool = False, tf: bool = False, poses: Collection[str] = (),
           drivers: Collection[int] = (), sensors: bool = False) -> dict[str, Rights]:
    """
    Return what each node of a formation may do, by the nodes' names.

    :param topology: who sees whom
    :param namespace: of the formation
    :param lockstep: whether the plant publishes ``/clock``
    :param mass: whether its bodies have mass, and so joints and a look
    :param tf: whether the monitor publishes ``/tf``
    :param poses: topics on which the plant, or the sensors, hear the poses of real bodies
    :param drivers: agents, from 1, whose bodies have a node that drives them
    :param sensors: whether all bodies are real, and the node ``sensors`` has the plant's place
    """
    base = namespace.rstrip('/')

    def full(name: str) -> str:
        return name if name.startswith('/') else f'{base}/{name}'

    agents = range(1, topology.n + 1)
    measurements = {(i, j): full(names.relative_attitude(i, j)) for i, j, _ in topology.edges}
    commands = {i: full(names.cmd_vel(i)) for i in agents}
    attitudes, cosines = full(names.ATTITUDES), full(names.COSINES)
    error, markers = full(names.ERROR), full(names.MARKERS)
    clock = {names.CLOCK} if lockstep else set()
    bodies = full(names.BODIES)
    joints = {full(names.joint_states(i)) for i in agents} if mass else set()
    nodes = {names.agent(i): Rights(
        publish={commands[i]},
        subscribe={topic for (a, _), topic in measurements.items() if a == i}) for i in agents}
    state = {attitudes, *measurements.values()}
    heard = {*commands.values(), *map(full, poses)}
    if sensors:
        nodes[names.SENSORS] = Rights(publish=state, subscribe=heard)
    else:
        nodes[names.PLANT] = Rights(
            publish={*state, *joints, *clock, *({bodies} if mass else ())}, subscribe=heard,
            reply={full(name) for name in (
                names.RESET, names.RANDOMIZE, names.PAUSE, names.stop(names.PLANT))})
    for i in drivers:
        nodes[names.body(i)] = Rights(
            publish={full(names.pose(i))}, subscribe={commands[i]},
            reply={full(names.stop(names.body(i)))})
    nodes[names.MONITOR] = Rights(
        publish={cosines, error, markers, *({names.TF} if tf else ())}, subscribe={attitudes})
    nodes[names.RECORDER] = Rights(subscribe={
        attitudes, cosines, error, names.DIAGNOSTICS, names.CLOCK, *measurements.values(),
        *commands.values(), *joints})
    nodes[names.VIEWER] = Rights(
        subscribe={attitudes, bodies, names.DIAGNOSTICS},
        request={
            *(full(name) for name in (names.RESET, names.RANDOMIZE, names.PAUSE)),
            *(full(f'{node}/{service}') for service in ('get_parameters', 'set_parameters')
              for node in (names.PLANT, names.MONITOR, *map(names.agent, agents)))})
    for name, right in nodes.items():
        right.publish |= {names.DIAGNOSTICS, '/rosout', '/parameter_events'}
        right.reply |= {full(f'{name}/{service}') for service in PARAMETER_SERVICES}
    return nodes


def document(nodes: dict[str, Rights], namespace: str = '') -> str:
    """
    Return the policy as XML, with an enclave for each node.

    :param nodes: of :func:`rights`
    :param namespace: of the formation
    """
    base = namespace.rstrip('/')
    policy = ElementTree.Element('policy', version=VERSION)
    enclaves = ElementTree.SubElement(policy, 'enclaves')
    for name, right in nodes.items():
        enclave = ElementTree.SubElement(enclaves, 'enclave', path=f'{base}/{name}')
        profiles = ElementTree.SubElement(enclave, 'profiles')
        profile = ElementTree.SubElement(profiles, 'profile', ns=base or '/', node=name)
        for kind, item, attribute, allowed in (
                ('services', 'service', 'reply', right.reply),
                ('services', 'service', 'request', right.request),
                ('topics', 'topic', 'publish', right.publish),
                ('topics', 'topic', 'subscribe', right.subscribe)):
            if allowed:
                group = ElementTree.SubElement(profile, kind, {attribute: 'ALLOW'})
                for full_name in sorted(allowed):
                    ElementTree.SubElement(group, item).text = full_name
    ElementTree.indent(policy)
    text = ElementTree.tostring(policy, encoding='unicode')
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'
