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

from geometry_msgs.msg import TwistStamped, Vector3Stamped
from harness import nanoseconds
from node_bench import Bench
import pytest
from tetra_ros2.nodes.plant import Plant
from tetra_ros2.wire import cdr

REST = [0.0, 0.0, 0.0, 1.0]
SEEN = 'agent_1/relative_attitude/agent_2'


@pytest.mark.parametrize('delay', [0.0, 0.02])
def test_after_a_reset_the_sensors_look_at_the_bodies_of_now(probe, delay):
    probe.listen(Vector3Stamped, SEEN)
    codecs = [cdr.twist_stamped(f'agent_{i}') for i in (1, 2)]
    # Noise that changes nothing makes even those without delay sensors of their own.
    with Bench(probe, Plant, topology__n=2, initial_attitudes=2 * REST, measurement_delay=delay,
               measurement_noise=1e-15) as bench:
        plant, stepper = bench.node, bench.node.stepper
        speakers = [bench.publisher(TwistStamped, f'agent_{i}/cmd_vel') for i in (1, 2)]
        bench.wait_for(lambda: plant.count_subscribers(SEEN), 'the probe')

        def seen_at(stamp):
            """Return the height of what agent 1 saw at a time: agent 2 turns upwards."""
            return bench.wait_for(lambda: [
                m.vector for m in probe.received[SEEN]
                if nanoseconds(m.header.stamp) == stamp], 'the measurement')[0].z

        def step():
            """Let agent 2 turn by 0.01 rad, about its second axis."""
            steps = stepper.steps
            for speaker, codec, rate in zip(speakers, codecs, (0.0, -1.0)):
                speaker.publish(codec.encode(stepper.stamp, 0, 0, 0, 0, rate, 0))
            bench.wait_for(lambda: stepper.steps > steps, 'a step')

        late = round(delay * 100)
        for _ in range(2):
            for k in range(6):
                assert seen_at(stepper.stamp) == pytest.approx(
                    0.01 * max(k - late, 0), abs=1e-4), 'late by as much as it is to be'
                step()
            plant.reset()
