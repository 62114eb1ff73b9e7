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

import array
import math
import re
from time import perf_counter

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import assert_close
from tetra_ros2.config import configuration
from tetra_ros2.config.configuration import (
    find_file,
    formation_from_parameters,
    gain_from_parameters,
    initial_attitudes,
    load,
    ParameterFile,
)
from tetra_ros2.config.parameters import (
    check_parameters,
    ConfigurationError,
    FORMATION,
    nearest,
    Parameter,
    PARAMETERS,
    shown,
)
from tetra_ros2.config.share import share_directory
from tetra_ros2.formation import gain as gains
from tetra_ros2.formation import shapes, stability, targets
from tetra_ros2.formation import topology as topologies
import yaml

SHIPPED = sorted(path.stem for path in (share_directory() / 'config').glob('*.yaml'))
EVERY_PARAMETER = [
    pytest.param(spec, id=f'{kind}-{spec.name}')
    for kind, specs in PARAMETERS.items() for spec in specs]


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a parameter file and returns its path."""
    def write(text):
        path = tmp_path / 'formation.yaml'
        path.write_text(text, encoding='utf-8')
        return path
    return write


def everywhere(parameters):
    """Return a parameter file that gives all nodes these parameters, in flow style."""
    return f'/**:\n  ros__parameters: {{{parameters}}}\n'


def refusal(path):
    """Return the message with which a parameter file is refused."""
    with pytest.raises(ConfigurationError) as refused:
        ParameterFile(path)
    message = str(refused.value)
    assert '\n' not in message
    assert message.startswith(f'{path}: ')
    return message.removeprefix(f'{path}: ')


# Parameters

@pytest.mark.parametrize('spec', EVERY_PARAMETER)
def test_every_parameter_says_what_it_is_and_has_a_default_that_is_valid(spec):
    assert re.fullmatch(r'[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)*', spec.name)
    assert re.fullmatch(r'[A-Z].*\.', spec.description)
    assert spec.expected
    assert spec.check(spec.default) == spec.default
    assert type(spec.check(spec.default)) is type(spec.default)


@pytest.mark.parametrize('kind', PARAMETERS)
def test_no_parameter_is_declared_twice(kind):
    names = [spec.name for spec in PARAMETERS[kind]]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize('spec', [p for p in EVERY_PARAMETER if p.values[0].minimum is not None])
def test_a_range_includes_its_ends_and_nothing_beyond(spec):
    kind = type(spec.default)
    assert spec.check(kind(spec.minimum)) == spec.minimum
    below = spec.minimum - 1 if kind is int else math.nextafter(spec.minimum, -math.inf)
    beyond = [below]
    if math.isfinite(spec.maximum):
        assert spec.check(kind(spec.maximum)) == spec.maximum
        beyond.append(
            spec.maximum + 1 if kind is int else math.nextafter(spec.maximum, math.inf))
    for value in beyond:
        with pytest.raises(ConfigurationError) as refused:
            spec.check(value)
        assert refused.value.key == spec.name
        assert 'is not valid' in refused.value.problem
        assert spec.expected in refused.value.problem


@pytest.mark.parametrize('spec', EVERY_PARAMETER)
def test_a_value_of_another_type_is_refused(spec):
    right = [bool, int, float] if isinstance(spec.default, float) else [type(spec.default)]
    others = [True, 'seven', 7, 0.5, (), {}, None, b'7', ['a', 1.0], [[1.0]]]
    if spec.items:
        others.remove(())
    for value in others:
        if type(value) in right and (not isinstance(value, bool) or right == [bool]):
            continue
        with pytest.raises(ConfigurationError):
            spec.check(value)


@pytest.mark.parametrize('spec', [
    p for p in EVERY_PARAMETER if isinstance(p.values[0].default, float)])
def test_a_whole_number_does_for_a_real_one_but_nan_does_not(spec):
    whole = math.ceil(spec.minimum)
    if whole > spec.maximum:
        return
    assert type(spec.check(whole)) is float
    with pytest.raises(ConfigurationError, match='nan is not valid'):
        spec.check(math.nan)


def test_an_integer_too_large_for_a_float_is_out_of_range():
    with pytest.raises(ConfigurationError, match='is not valid'):
        Parameter('rate', 1.0, 'Rate.', minimum=0.0, maximum=math.inf).check(10**400)


@given(st.lists(st.floats(-1e6, 1e6), max_size=12))
def test_a_list_of_numbers_may_come_as_rclpy_hands_it_out(values):
    spec = next(spec for spec in FORMATION if spec.name == 'pointing_axis')
    assert spec.check(array.array('d', values)) == tuple(values)
    assert spec.check([round(value) for value in values]) == tuple(
        float(round(value)) for value in values)


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_a_list_of_finite_numbers_takes_no_other(bad):
    spec = next(spec for spec in FORMATION if spec.name == 'pointing_axis')
    assert 'finite' in spec.expected
    with pytest.raises(ConfigurationError, match='is not valid'):
        spec.check([1.0, 0.0, bad])


@pytest.mark.parametrize('kind', PARAMETERS)
def test_what_is_not_given_is_at_its_default(kind):
    assert check_parameters(kind, {}) == {spec.name: spec.default for spec in PARAMETERS[kind]}


def test_given_parameters_replace_the_defaults_and_every_rclpy_nodes_own_are_let_through():
    values = check_parameters('plant', {
        'rate': 50, 'use_sim_time': True, 'qos_overrides./clock.publisher.depth': 3})
    assert values['rate'] == 50.0
    assert set(values) == {spec.name for spec in PARAMETERS['plant']}


def test_an_unknown_parameter_is_refused_with_the_nearest_right_one():
    with pytest.raises(ConfigurationError) as refused:
        check_parameters('agent', {'measurement_time_out': 1.0})
    assert refused.value.key == 'measurement_time_out'
    assert "did you mean 'measurement_timeout'?" in str(refused.value)


def test_a_hint_is_given_only_when_there_is_something_near():
    assert 'cosine' in nearest('cosin', ('cosine', 'linear'))
    assert nearest('zzz', ('cosine', 'linear')) == ''


def test_a_long_value_is_cut_in_a_message():
    assert shown('short') == "'short'"
    assert len(shown(list(range(1000)))) < 80


@pytest.mark.parametrize('family', gains.KINDS)
@given(exponent=st.floats(-9.0, 9.0))
def test_every_amplitude_in_its_range_makes_a_gain(family, exponent):
    values = {'gain.kind': family, 'gain.a': 10.0**exponent, 'gain.b': 1.0}
    assert gain_from_parameters(values).a == 10.0**exponent


# From parameters to objects

def formation(**given):
    names = {name.replace('__', '.'): value for name, value in given.items()}
    return formation_from_parameters(check_parameters('monitor', names))


def test_the_defaults_are_the_papers_first_formation():
    built = formation()
    np.testing.assert_array_equal(built.topology.weights, topologies.complete(4).weights)
    assert built.gain == gains.Cosine()
    np.testing.assert_array_equal(built.pointing_axes, [[1.0, 0.0, 0.0]] * 4)


@pytest.mark.parametrize('k, p', [(k, p) for k in (1, 2, 3, 4) for p in (0, 1)])
def test_k_and_p_choose_the_rotating_graph(k, p):
    built = formation(topology__kind='rotating', topology__k=k, topology__p=p)
    np.testing.assert_array_equal(built.topology.weights, topologies.rotating(k, p).weights)


def test_edges_may_have_weights_or_not():
    built = formation(
        topology__kind='custom', topology__n=3, topology__edges=['1 2 0.5', '2 1', ' 3  1  -2e-1'])
    assert built.topology.edges == ((1, 2, 0.5), (2, 1, 1.0), (3, 1, -0.2))


def test_an_agent_that_sees_nobody_is_allowed():
    built = formation(topology__kind='custom', topology__n=3, topology__edges=['1 2', '2 1'])
    assert built.topology.agents_without_neighbors == (3,)


def test_one_axis_is_for_all_agents_and_every_axis_is_normalised():
    assert_close(
        formation(pointing_axis=[3.0, 0.0, 4.0]).pointing_axes, [[0.6, 0.0, 0.8]] * 4, atol=1e-15)
    each = formation(topology__n=2, pointing_axis=[3.0, 0.0, 4.0, 0.0, -1e-9, 0.0])
    assert_close(each.pointing_axes, [[0.6, 0.0, 0.8], [0.0, -1.0, 0.0]], atol=1e-15)


def test_three_numbers_are_one_axis_even_for_an_agent_count_of_three():
    assert_close(
        formation(topology__n=3, pointing_axis=[0.0, 1.0, 0.0]).pointing_axes,
        [[0.0, 1.0, 0.0]] * 3, 0.0)


def test_initial_attitudes_are_normalised_and_none_where_none_were_given():
    assert initial_attitudes({'initial_attitudes': ()}, 2) is None
    given = [0.0, 0.0, 0.0, 1.0005, 0.5, -0.5, 0.5, 0.5]
    assert_close(
        initial_attitudes({'initial_attitudes': given}, 2),
        [[0.0, 0.0, 0.0, 1.0], [0.5, -0.5, 0.5, 0.5]], atol=1e-15)


# Wrong values

TOPOLOGY_OF_4 = 'topology.kind: custom, topology.n: 4, topology.edges: '

WRONG = [
    # what a user wrote, and what the message must contain beside the file
    ('topology.kind: complet',
     ['topology.kind', "'complet'", "did you mean 'complete'?", 'custom']),
    ('gain.kind: cosinus', ['gain.kind', "'cosinus'", "did you mean 'cosine'?", 'exponential']),
    ('topology: {kind: polyhedron, polyhedron: octohedron}',
     ['topology.polyhedron', "'octohedron'", "did you mean 'octahedron'?", 'dodecahedron']),
    ('topology: {kind: polyhedron, axis: "0 0 0"}', ['topology.axis', "'0 0 0'", 'not zero']),
    ('topology: {kind: polyhedron, axis: "nan 0 1"}', ['topology.axis', 'must be finite']),
    ('topology: {kind: polyhedron, axis: [0, 0, 1]}',
     ['topology.axis', '[0, 0, 1] is not valid', 'three numbers in quotes']),
    ('topology: {kind: polyhedron, axis: vertx}', ['topology.axis', "did you mean 'vertex'?"]),
    ('topology: {kind: polyhedron, spin: 1.5}', ['topology.spin', '1.5', 'from -1 to 1']),
    ('topology: {kind: polyhedron, polyhedron: cube, n: 4}',
     ['topology.n', '4 is not valid', 'the cube needs 8']),
    ('topology: {kind: polyhedron, polyhedron: cube, class_weights: [1.0, 2.0]}',
     ['topology.class_weights', '2 weights', '3 classes']),
    ('topology: {kind: polyhedron, polyhedron: cube, class_weights: [0.0, 0.0, 0.0]}',
     ['topology.class_weights', 'at least one class']),
    ('topology: {spin: 0.5}', ['topology.spin', 'a complete topology has no spin']),
    ('topology: {kind: rotating, class_weights: [1.0]}', ['topology.class_weights', 'rotating']),
    ('topology: {kind: ring, n: 1}', ['topology.n', '1 is not valid', 'from 2']),
    ('topology: {points: [1.0, 0.0, 0.0]}', ['topology.points', 'its own shape']),
    ('topology: {kind: custom, n: 2, edges: ["1 2"], points: [1.0, 0.0]}',
     ['topology.points', '2 numbers', '3 for each']),
    ('topology: {kind: custom, n: 2, edges: ["1 2"], points: [1.0, 0.0, 0.0]}',
     ['topology.points', '3 numbers', '6 for 2 agents']),
    ('topology: {kind: custom, n: 2, edges: ["1 2"], points: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]}',
     ['topology.points', 'agent 2', 'not zero']),
    ('topology: {kind: rotating, k: 5}', ['topology.k', '5 is not valid', 'from 1 to 4']),
    ('topology: {kind: rotating, k: 0}', ['topology.k', '0 is not valid', 'from 1 to 4']),
    ('topology: {kind: rotating, p: 2}', ['topology.p', '2 is not valid', 'from 0 to 1']),
    ('topology: {kind: rotating, p: true}', ['topology.p', 'True is not', 'an integer']),
    ('topology: {kind: rotating, n: 5}', ['topology.n', '5 is not valid', 'needs 4']),
    ('topology.n: 1', ['topology.n', '1 is not valid', 'an integer from 2']),
    ('topology.n: 4.0', ['topology.n', '4.0 is not valid', 'an integer from 0']),
    ('topology.n: "4"', ['topology.n', "'4' is not valid", 'an integer from 0']),
    ('gain.a: -1.0', ['gain.a', '-1.0 is not valid', 'a number from']),
    ('gain.a: .nan', ['gain.a', 'nan is not valid', 'a number from']),
    ('gain.a: .inf', ['gain.a', 'inf is not valid', 'a number from']),
    ('gain.a: 1' + 400 * '0', ['gain.a', 'is not valid', 'a number from']),
    ('gain.b: 0.0', ['gain.b', '0.0 is not valid', 'a number from']),
    ('gain: {kind: linear, b: 2.0}', ['gain: ', 'f > 0', '(0, pi)']),
    ('gain: {kind: gaussian, b: 100.0}', ['gain: ', 'f > 0', '(0, pi)']),
    ('rate: 0.0', ['rate', '0.0 is not valid', 'a number from 0.001']),
    ('rate: fast', ['rate', "'fast' is not valid", 'a number from 0.001']),
    ('rate:', ['rate', "'' is not valid", 'a number from 0.001']),
    ('mode: real_time', ['mode', "'real_time'", "did you mean 'realtime'?", 'lockstep']),
    ('seed: -2', ['seed', '-2 is not valid', 'from -1']),
    ('seed: 1.5', ['seed', '1.5 is not valid', 'an integer from -1']),
    ('tolerance: 4.0', ['tolerance', '4.0 is not valid', 'to 3.14']),
    ('storage: mcab', ['storage', "'mcab'", "did you mean 'mcap'?", 'sqlite3']),
    ('topics: /tf', ['topics', "'/tf' is not valid", 'a list of strings']),
    ('output: 7', ['output', '7 is not valid', 'a string']),
    (TOPOLOGY_OF_4 + '["1 2", "1-3"]', ['topology.edges[1]', "'1-3'", '"i j weight"']),
    (TOPOLOGY_OF_4 + '["1"]', ['topology.edges[0]', "'1'", '"i j"']),
    (TOPOLOGY_OF_4 + '["1 2 1.0 1.0"]', ['topology.edges[0]', "'1 2 1.0 1.0'", '"i j weight"']),
    (TOPOLOGY_OF_4 + '["1 2 heavy"]', ['topology.edges[0]', "'1 2 heavy'", '"i j weight"']),
    (TOPOLOGY_OF_4 + '["1.0 2"]', ['topology.edges[0]', "'1.0 2'", '"i j"']),
    (TOPOLOGY_OF_4 + '["1 2", "1 5"]', ['topology.edges[1]', "'1 5'", 'no agent 5 among 4']),
    (TOPOLOGY_OF_4 + '["0 1"]', ['topology.edges[0]', "'0 1'", 'no agent 0 among 4']),
    (TOPOLOGY_OF_4 + '["1 2", "2 1", "1 2 3.0"]', ['topology.edges[2]', 'more than once']),
    (TOPOLOGY_OF_4 + '["3 3"]', ['topology.edges[0]', "'3 3'", 'agent 3 cannot see itself']),
    (TOPOLOGY_OF_4 + '["1 2 0"]', ['topology.edges[0]', "'1 2 0'", 'not 0']),
    (TOPOLOGY_OF_4 + '["1 2 nan"]', ['topology.edges[0]', "'1 2 nan'", 'finite']),
    (TOPOLOGY_OF_4 + '[1, 2]', ['topology.edges', '[1, 2]', 'a list of strings']),
    (TOPOLOGY_OF_4 + '"1 2"', ['topology.edges', "'1 2'", 'a list of strings']),
    ('topology.edges: ["1 2"]', ['topology.edges', 'complete', 'kind: custom']),
    ('topology: {kind: rotating, edges: ["1 2"]}', ['topology.edges', 'rotating', 'custom']),
    ('pointing_axis: [1.0, 0.0]', ['pointing_axis', '2 numbers', 'expected 3', '12 for 4 agents']),
    ('pointing_axis: []', ['pointing_axis', '0 numbers', 'expected 3', '12 for 4 agents']),
    ('pointing_axis: [0.0, 0.0, 0.0]', ['pointing_axis', 'agent 1', 'not zero']),
    ('topology.n: 2, pointing_axis: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]',
     ['pointing_axis', 'agent 2', 'not zero']),
    ('pointing_axis: [.inf, 0.0, 0.0]', ['pointing_axis', 'inf', 'finite']),
    ('pointing_axis: 1.0', ['pointing_axis', '1.0 is not valid', 'a list of finite numbers']),
    ('pointing_axis: [1, 0.5, 0]', ['pointing_axis', '[1, 0.5, 0]', 'one type', 'write 1.0']),
    ('pointing_axis: [1.0, true, 0.0]', ['pointing_axis', 'True', 'one type']),
    ('topics: [/tf, 1]', ['topics', "['/tf', 1]", 'one type']),
    ('initial_attitudes: [0.0, 0.0, 0.0, 1.0]',
     ['initial_attitudes', '4 numbers', 'expected 16 for 4 agents']),
    ('topology.n: 2, initial_attitudes: [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0]',
     ['initial_attitudes', '[1.0, 1.0, 0.0, 0.0]', 'agent 2', 'unit']),
    ('ratee: 5.0', ['ratee', 'no such parameter', "did you mean 'rate'?"]),
    ('gain: {amplitude: 1.0}', ['gain.amplitude', 'no such parameter']),
    ('topology: complete', ['topology', 'no such parameter']),
]


@pytest.mark.parametrize('parameters, fragments', WRONG, ids=[wrong[:60] for wrong, _ in WRONG])
def test_a_wrong_value_is_refused_with_its_key_and_what_would_be_right(
        write, parameters, fragments):
    message = refusal(write(everywhere(parameters)))
    for fragment in fragments:
        assert fragment in message


@pytest.mark.parametrize('text, fragments', [
    ('/**: {', ['is not YAML', 'line 1, column 7']),
    ('/**:\n\tros__parameters: {}', ['is not YAML', 'line 2, column 1']),
    ('', ['not a ROS 2 parameter file', 'ros__parameters:']),
    ('- 1\n- 2\n', ['not a ROS 2 parameter file', 'ros__parameters:']),
    ('rate: 5.0\n', ['rate', 'ros__parameters:']),
    ('/**:\n', ['**', 'ros__parameters:']),
    ('/**: {}\n', ['**', 'ros__parameters:']),
    ('/**:\n  ros__parameters:\n', ['**', 'expected parameters']),
    ('/**:\n  ros__parameters: [1]\n', ['**', 'expected parameters']),
    ('/**:\n  parameters:\n    rate: 5.0\n', ['**/parameters', 'ros__parameters:']),
])
def test_what_is_no_parameter_file_is_refused(write, text, fragments):
    message = refusal(write(text))
    for fragment in fragments:
        assert fragment in message


def test_a_binary_file_is_refused(tmp_path):
    path = tmp_path / 'formation.yaml'
    path.write_bytes(bytes(range(256)))
    assert 'not a text file' in refusal(path)


def test_a_file_that_is_not_there_is_refused_with_the_names_that_ship(tmp_path):
    missing = tmp_path / 'missing.yaml'
    with pytest.raises(ConfigurationError) as refused:
        load(missing)
    assert str(refused.value).startswith(f'{missing}: there is no such file')
    for name in SHIPPED:
        assert name in str(refused.value)
    assert 'No such file' in refusal(missing)


def test_a_directory_is_refused_as_one(tmp_path):
    with pytest.raises(ConfigurationError, match='is a directory') as refused:
        load(tmp_path)
    assert str(refused.value).startswith(f'{tmp_path}: ')
    assert 'directory' in refusal(tmp_path)


def test_a_shipped_name_that_is_misspelt_gets_a_hint():
    with pytest.raises(ConfigurationError, match="did you mean 'rotating'"):
        find_file('rotatin')


def test_an_alias_is_refused_as_rcl_refuses_it(write):
    text = '/**:\n  ros__parameters: &all {gain.a: 1.0}\n/**/plant:\n  ros__parameters: *all\n'
    with pytest.raises(ConfigurationError):
        ParameterFile(write(text))


def test_a_file_that_contains_itself_is_refused(write):
    with pytest.raises(ConfigurationError):
        ParameterFile(write('/**:\n  ros__parameters: &all {gain: *all}\n'))


# Sections: what they are for, and which node takes what

@pytest.mark.parametrize('section, hint', [
    ('/**/plan', 'plant'), ('/**/agent1', 'agent_1'), ('/**/agent', 'agent_1'),
    ('/**/agent_*', 'agent_1'), ('/**/monitr', 'monitor'), ('/ns/recoder', 'recorder')])
def test_a_section_of_a_misspelt_node_is_refused_with_the_nearest(write, section, hint):
    message = refusal(write(f'{section}:\n  ros__parameters: {{rate: 5.0}}\n'))
    assert section.strip('/') in message
    assert f"did you mean '{hint}'?" in message


def test_a_section_of_somebody_elses_node_is_ignored(write):
    file = ParameterFile(write(
        '/**/camera_driver:\n  ros__parameters: {rate: fast, exposure: 0}\n'))
    assert file.values('plant') == check_parameters('plant', {})


@pytest.mark.parametrize('agent', ['agent_7', 'agent_5', 'agent_0'])
def test_a_section_of_an_agent_that_does_not_exist_is_refused(write, agent):
    message = refusal(write(f'/**/{agent}:\n  ros__parameters: {{rate: 5.0}}\n'))
    assert agent in message
    assert f'no agent {agent[-1]} among 4' in message


@pytest.mark.parametrize('section, key', [
    ('/**/agent_1', 'seed'), ('/**/plant', 'measurement_timeout'), ('/monitor', 'rate'),
    ('/**/recorder', 'gain.a')])
def test_a_parameter_of_another_node_is_refused(write, section, key):
    assert f'{key}: there is no such parameter' in refusal(
        write(f'{section}:\n  ros__parameters: {{{key}: 1}}\n'))


@pytest.mark.parametrize('section', ['/**', '/*', '/**/plant', '/plant', 'plant'])
def test_what_every_rclpy_node_has_may_be_set(write, section):
    ParameterFile(write(
        f'{section}:\n  ros__parameters:\n    use_sim_time: true\n'
        '    qos_overrides: {/clock: {publisher: {depth: 3}}}\n'))


# What rcl 9.2 does with each, as found by hand with --ros-args --params-file.
MATCHES = [
    ('/**', ['/plant', '/ns/plant', '/a/b/plant']),
    ('/*', ['/plant']),
    ('*/*', ['/ns/plant']),
    ('/**/*', ['/plant', '/ns/plant', '/a/b/plant']),
    ('plant', ['/plant']),
    ('/plant', ['/plant']),
    ('/**/plant', ['/plant', '/ns/plant', '/a/b/plant']),
    ('**/plant', ['/plant', '/ns/plant', '/a/b/plant']),
    ('/*/plant', ['/ns/plant']),
    ('/ns/plant', ['/ns/plant']),
    ('ns/plant', ['/ns/plant']),
    ('/ns/**', ['/ns/plant']),
    ('/ns/*', ['/ns/plant']),
    ('/ns/**/plant', ['/ns/plant']),
    ('/**/ns/plant', ['/ns/plant']),
    ('/a/b/plant', ['/a/b/plant']),
    ('/a/*/plant', ['/a/b/plant']),
    ('/*/b/plant', ['/a/b/plant']),
    ('/a/**', ['/a/b/plant']),
    ('/b/plant', []),
]


@pytest.mark.parametrize('section, nodes', MATCHES)
def test_a_section_is_for_the_nodes_that_rcl_takes_it_for(write, section, nodes):
    file = ParameterFile(write(f'"{section}":\n  ros__parameters: {{rate: 5.0}}\n'))
    for node in ('/plant', '/ns/plant', '/a/b/plant'):
        assert file.given(node) == ({'rate': 5.0} if node in nodes else {})
        assert file.values('plant', node)['rate'] == (5.0 if node in nodes else 100.0)


@pytest.mark.parametrize('text, node', [
    ('ns:\n  plant:\n    ros__parameters: {rate: 5.0}\n', '/ns/plant'),
    ('/ns:\n  plant:\n    ros__parameters: {rate: 5.0}\n', '/ns/plant'),
    ('a:\n  b:\n    plant:\n      ros__parameters: {rate: 5.0}\n', '/a/b/plant'),
    ('/a/b:\n  plant:\n    ros__parameters: {rate: 5.0}\n', '/a/b/plant'),
    ('/**:\n  plant:\n    ros__parameters: {rate: 5.0}\n', '/a/b/plant'),
])
def test_namespaces_may_be_nested_levels(write, text, node):
    file = ParameterFile(write(text))
    assert file.given(node) == {'rate': 5.0}
    assert file.given('/elsewhere/plant') == (
        {'rate': 5.0} if text.startswith('/**') else {})


def test_later_sections_win_however_general(write):
    file = ParameterFile(write(
        '/plant:\n  ros__parameters: {rate: 1.0, seed: 1}\n'
        '/**:\n  ros__parameters: {rate: 2.0}\n'
        '/*/plant:\n  ros__parameters: {rate: 3.0}\n'))
    assert file.given('/plant') == {'rate': 2.0, 'seed': 1}
    assert file.given('/ns/plant') == {'rate': 3.0}
    assert file.given('/a/b/plant') == {'rate': 2.0}


def test_a_level_may_be_written_with_dots_and_the_later_of_the_two_wins(write):
    nested_first = 'gain: {a: 2.0, b: 3.0}, gain.a: 4.0'
    dots_first = 'gain.a: 4.0, gain: {a: 2.0, b: 3.0}'
    for text, a in ((nested_first, 4.0), (dots_first, 2.0)):
        values = ParameterFile(write(everywhere(text))).values('plant')
        assert (values['gain.a'], values['gain.b']) == (a, 3.0)


def test_parameters_of_a_namespace_win_over_nested_sections_before_them_as_in_rcl(write):
    file = ParameterFile(write(
        '/**:\n  plant:\n    ros__parameters: {rate: 2.0}\n  ros__parameters: {rate: 1.0}\n'))
    assert file.given('/plant') == {'rate': 1.0}


def test_sections_nested_below_parameters_are_refused_as_rcl_refuses_them(write):
    message = refusal(write(
        '/**:\n  ros__parameters: {rate: 1.0}\n  plant:\n    ros__parameters: {rate: 2.0}\n'))
    assert 'plant' in message


def test_a_section_written_twice_counts_twice_as_in_rcl(write):
    text = '/plant:\n  ros__parameters: {{seed: {}}}\n/plant:\n  ros__parameters: {{rate: 2.0}}\n'
    assert ParameterFile(write(text.format(3))).given('/plant') == {'seed': 3, 'rate': 2.0}
    assert "'three' is not valid" in refusal(write(text.format('three')))


@pytest.mark.parametrize('written, value', [
    ('1e2', 100.0), ('1.0e2', 100.0), ('1e-2', 0.01), ('1.0e+2', 100.0), ('5', 5.0),
    ('.5', 0.5), ('0x10', 16.0)])
def test_a_number_is_one_however_rcl_lets_it_be_written(write, written, value):
    assert ParameterFile(write(everywhere(f'rate: {written}'))).values('plant')['rate'] == value


def test_numbers_in_a_list_are_such_however_rcl_lets_them_be_written(write):
    file = ParameterFile(write(everywhere('pointing_axis: [1e0, 0.0, -1.0e0]')))
    assert file.values('plant')['pointing_axis'] == (1.0, 0.0, -1.0)


@pytest.mark.parametrize('written', ['2026-05-01', '2026-13-45', '12:30', '1_000', '0x_'])
def test_what_is_no_number_to_rcl_is_a_string(write, written):
    assert ParameterFile(write(everywhere(f'output: {written}'))).values('recorder')[
        'output'] == written
    assert f"'{written}' is not valid" in refusal(write(everywhere(f'rate: {written}')))


def test_whole_numbers_do_in_a_list_when_all_are_whole(write):
    file = ParameterFile(write(everywhere('pointing_axis: [0, 0, 1]')))
    assert_close(file.formation().pointing_axes, [[0.0, 0.0, 1.0]] * 4, atol=0.0)


# Every node that a file speaks of is checked, not only those of the usual names

@pytest.mark.parametrize('section', ['/ns/plant', '/ns/**', 'ns/*', '/*/agent_2', '/a/b/agent_2'])
def test_a_wrong_value_for_a_node_in_a_namespace_is_refused(write, section):
    assert 'rate: 0.0 is not valid' in refusal(
        write(f'{section}:\n  ros__parameters: {{rate: 0.0}}\n'))


@pytest.mark.parametrize('node', ['plant', 'monitor', 'agent_3'])
def test_values_of_one_node_that_do_not_fit_together_are_refused(write, node):
    assert 'pointing_axis' in refusal(
        write(f'/**/{node}:\n  ros__parameters: {{pointing_axis: [0.0, 0.0, 0.0]}}\n'))


@pytest.mark.parametrize('node', ['plant', 'monitor', 'agent_4'])
def test_a_node_of_another_number_of_agents_than_the_others_is_refused(write, node):
    assert 'topology.n' in refusal(
        write(f'/**/{node}:\n  ros__parameters: {{topology.n: 3}}\n'))


def test_one_agent_may_have_a_gain_of_its_own(write):
    file = ParameterFile(write('/**/agent_3:\n  ros__parameters: {gain.a: 2.0}\n'))
    gains_of = [
        gain_from_parameters(file.values('agent', f'/agent_{i}')).a for i in (1, 2, 3, 4)]
    assert gains_of == [1.0, 1.0, 2.0, 1.0]


def test_a_graph_of_many_edges_is_read_at_once(write):
    n = 24
    edges = [f'"{i} {j}"' for i in range(1, n + 1) for j in range(1, n + 1) if i != j]
    path = write(everywhere(f'topology: {{kind: custom, n: {n}, edges: [{", ".join(edges)}]}}'))
    start = perf_counter()
    assert len(ParameterFile(path).formation().topology.edges) == n * (n - 1)
    assert perf_counter() - start < 1.0


# What ships

def test_the_papers_two_graphs_ship():
    assert {'complete', 'rotating'} <= set(SHIPPED)


@pytest.mark.parametrize('name', SHIPPED)
def test_every_shipped_configuration_loads_by_its_bare_name_and_by_its_path(name):
    by_name, by_path = load(name), load(share_directory() / 'config' / f'{name}.yaml')
    assert by_name.path == by_path.path
    assert by_name.values('plant') == by_path.values('plant')
    assert by_name.formation().topology.n >= 2


def test_the_shipped_rotating_formation_is_the_papers_graph_of_the_first_agent():
    topology = load('rotating').formation().topology
    np.testing.assert_array_equal(topology.weights, topologies.rotating(1, 1).weights)


def test_a_file_in_the_working_directory_goes_before_one_that_ships(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_file('rotating').parent == share_directory() / 'config'
    (tmp_path / 'rotating').write_text(everywhere('rate: 5.0'))
    assert load('rotating').values('plant')['rate'] == 5.0


# Where a value stops being valid

@pytest.mark.parametrize(('length', 'accepted'), [
    (1.0 + 0.9e-3, True), (1.0 - 0.9e-3, True), (1.0 + 1.1e-3, False), (1.0 - 1.1e-3, False)])
def test_a_quaternion_may_be_a_thousandth_off_unit_length(length, accepted):
    given = {'initial_attitudes': [0.0, 0.0, 0.0, length]}
    if accepted:
        assert_close(initial_attitudes(given, 1), [[0.0, 0.0, 0.0, 1.0]], atol=1e-15)
    else:
        with pytest.raises(ConfigurationError, match='unit'):
            initial_attitudes(given, 1)


@pytest.mark.parametrize(('text', 'value'), [
    ('017', 15), ('-017', -15), ('0', 0), ('00', 0), ('07', 7), ('010', 8), ('089', 89),
    ('0x1F', 31), ('17', 17)])
def test_an_integer_that_begins_with_zero_is_octal_as_rcl_has_it(text, value):
    node = yaml.compose(text, Loader=yaml.SafeLoader)
    assert configuration._scalar(node) == value


@pytest.mark.parametrize(('seed', 'accepted'), [
    (-2, False), (-1, True), (0, True), (2**63 - 1, True), (2**63, False)])
def test_a_seed_is_what_an_integer_parameter_can_hold(seed, accepted):
    if accepted:
        assert check_parameters('plant', {'seed': seed})['seed'] == seed
    else:
        with pytest.raises(ConfigurationError, match='seed'):
            check_parameters('plant', {'seed': seed})


@pytest.mark.parametrize('name, n, spins', [
    ('octahedron', 6, False), ('cube', 8, False), ('icosahedron', 12, False),
    ('dodecahedron', 20, False), ('spinning_octahedron', 6, True), ('spinning_cube', 8, True),
    ('spinning_icosahedron', 12, True), ('spinning_dodecahedron', 20, True), ('ring', 5, True)])
def test_the_shipped_solids_are_stable_formations_that_spin_or_not(name, n, spins):
    formation = configuration.load(name).formation()
    assert formation.n == n
    assert shapes.reservation(formation.topology, formation.gain) is None
    there = stability.transverse(
        formation.shape.points, formation.topology.weights, formation.gain)
    assert there.residual < 1e-12
    assert there.is_hyperbolic
    assert there.spins is spins


@pytest.mark.parametrize('kind', ['octahedron', 'cube'])
def test_the_cosine_gain_is_warned_of_where_it_leads_to_a_continuum(kind):
    topology = targets.polyhedron(kind)
    assert 'it is one of a continuum' in shapes.reservation(topology, gains.Cosine())
    assert shapes.reservation(topology, gains.Exponential()) is None


@pytest.mark.parametrize('text', ['0.3 -0.5 0.8', '[0.3, -0.5, 0.8]', '0.6, -1.0, 1.6'])
def test_an_axis_of_three_numbers_may_be_written_in_these_ways(write, text):
    axis = ParameterFile(write(everywhere(
        f'topology: {{kind: polyhedron, axis: "{text}", spin: 0.5}}'))).formation().topology.axis
    assert np.allclose(axis, np.array([0.3, -0.5, 0.8]) / np.sqrt(0.98))
