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
What is said of bodies with mass, measured at length: ``python -m benchmarks.bodies``.

The quick variants are tests; the figures in ``docs/real-bodies.md`` are printed here.
"""

import argparse
import contextlib
import math
import os
import signal
import subprocess
import sys
import time

from geometry_msgs.msg import PoseArray
import mujoco
import numpy as np
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from tetra_ros2.formation import (
    gain,
    law,
    measures,
    rate_loop,
    rotation,
    shapes,
    sphere,
    topology,
)
from tetra_ros2.formation.simulation import SampledLoop
from tetra_ros2.physics.bodies import make_bodies
from tetra_ros2.physics.settings import Physics, RateLoop, Wheels
from tetra_ros2.ros.executor import leave

TETRAHEDRON = shapes.TETRAHEDRON.points
THETA = math.acos(-1.0 / 3.0)
COSINE = gain.Cosine()


def axes(n):
    """Return the pointing axes of n bodies."""
    return np.tile([1.0, 0.0, 0.0], (n, 1))


def loop_of(physics, graph, attitudes):
    """Return a sampled loop whose bodies have mass."""
    loop = SampledLoop(attitudes, axes(graph.n), graph, COSINE)
    loop.bodies = make_bodies(attitudes, axes(graph.n), physics)
    return loop


def error(loop):
    """Return how far the angles are from a tetrahedron [rad]."""
    angles = measures.pairwise_angles(np.array(loop.bodies.reduced))
    return float(np.max(np.abs(angles - THETA)))


def limit(h=0.05, seconds=320.0):
    """Bisect for the bandwidth above which the wheels of MuJoCo keep a spinning tetrahedron."""
    graph = topology.rotating()
    predicted = rate_loop.min_bandwidth(TETRAHEDRON, graph.weights, COSINE, h=h)

    def grows(k):
        there = rate_loop.rate_loop_equilibrium(TETRAHEDRON, graph.weights, COSINE, k, h=h)
        rng = np.random.default_rng(1)
        attitudes = rotation.multiply(there.attitudes, rotation.exp(
            1e-4 * rng.standard_normal((4, 3))))
        physics = Physics('wheels', rate=100.0, loop=RateLoop(k),
                          wheels=Wheels(torque_limit=10.0, speed_limit=1e5))
        loop = loop_of(physics, graph, attitudes)
        loop.bodies._velocities[:, 4:6] = there.rates  # already spinning
        # With the wheels' momentum, so that the sum is none, as from rest.
        turning = np.concatenate([np.zeros((4, 1)), there.rates], axis=1)
        inertia = loop.bodies._vehicle.momentum[:, 3:6]
        loop.bodies._velocities[:, 6:9] = -(turning @ inertia) / physics.wheels.inertia
        angles = []
        for _ in range(round(seconds / h / 4)):
            loop.advance(h, 4)
            angles.append(measures.pairwise_angles(np.array(loop.bodies.reduced)))
        quarter = len(angles) // 4
        early, late = (np.max(np.ptp(np.array(angles[at:at + quarter]), axis=0))
                       for at in (2 * quarter, 3 * quarter))
        return late > early

    low, high = 0.8 * predicted, 1.25 * predicted
    while high / low > 1.01:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if grows(middle) else (low, middle)
    found = math.sqrt(low * high)
    return (f'stability limit at {1.0 / h:g} Hz: predicted {predicted:.4f} 1/s, found '
            f'{found:.4f} 1/s by bisection, {100.0 * (found / predicted - 1.0):+.1f} %')


def sides():
    """Follow random starts with a rate loop of twice and of half the limit."""
    graph, h = topology.rotating(), 0.05
    predicted = rate_loop.min_bandwidth(TETRAHEDRON, graph.weights, COSINE, h=h)
    lines = []
    for factor in (2.0, 0.5):
        there = rate_loop.rate_loop_equilibrium(
            TETRAHEDRON, graph.weights, COSINE, factor * predicted, h=h)
        target = np.sort(measures.pairwise_angles(there.gamma))
        settled = 0
        for seed in range(5):
            attitudes = rotation.random(np.random.default_rng(seed), (4,))
            physics = Physics('wheels', rate=100.0, loop=RateLoop(factor * predicted))
            loop = loop_of(physics, graph, attitudes)
            loop.advance(h, round(200.0 / h))
            angles = np.sort(measures.pairwise_angles(np.array(loop.bodies.reduced)))
            settled += bool(np.max(np.abs(angles - target)) < 0.01)
        lines.append(f'rate loop at {factor:g} times the limit: {settled} of 5 random starts are '
                     'at the predicted shape after 200 s')
    return '\n'.join(lines)


def saturation():
    """Form from random starts with ever weaker wheels."""
    graph, lines = topology.complete(), []
    for limit_ in (10.0, 0.1, 0.02, 0.005, 0.001):
        times, limited = [], 0
        for seed in range(10):
            attitudes = rotation.random(np.random.default_rng(seed), (4,))
            loop = loop_of(Physics('wheels', rate=500.0, wheels=Wheels(
                torque_limit=limit_)), graph, attitudes)
            steps = 0
            while error(loop) > 1e-3 and steps < 20000:
                loop.advance(0.02, 5)
                steps += 5
            times.append(0.02 * steps if error(loop) <= 1e-3 else math.inf)
            limited += sum(loop.bodies.saturated_steps)
        lines.append(f'torque limit {limit_:g} N m: formed {np.isfinite(times).sum()} of 10, '
                     f'median {np.median(times):.1f} s, {limited} saturated steps')
    return '\n'.join(lines)


def weak(starts=200, h=0.02):
    """Search for a formation that ever weaker wheels keep from coming to rest, without MuJoCo."""
    graph, lines = topology.complete(), []
    rng = np.random.default_rng(0)
    # For each: the largest angular acceleration [rad/s^2] and the bandwidth [1/s] of each body.
    cases = {f'{limit_:g} rad/s^2': (np.full((starts, 4), limit_), np.full((starts, 1), 10.0))
             for limit_ in (1.0, 0.1, 0.03, 0.01, 0.003)}
    cases['0.01 to 1 rad/s^2, for each body another'] = (
        10.0 ** rng.uniform(-2.0, 0.0, (starts, 4)), 10.0 ** rng.uniform(0.0, 1.0, (starts, 1)))
    for name, (limits, bandwidths) in cases.items():
        def acceleration(gamma, rates, limits=limits[:, :, None], k=bandwidths[:, :, None]):
            wanted = k * (law.velocity(gamma, graph.weights, COSINE) - rates)
            size = np.linalg.norm(wanted, axis=-1, keepdims=True)
            turned = np.sum(rates * rates, axis=-1, keepdims=True) * gamma
            return wanted * np.minimum(1.0, limits / np.maximum(size, 1e-300)) - turned

        gamma = sphere.normalize(rng.standard_normal((starts, 4, 3)))
        rates = np.zeros_like(gamma)
        seconds = 120.0 / math.sqrt(float(np.min(limits)))
        fastest = 0.0
        for _ in range(round(seconds / h)):  # by the midpoint rule
            half = sphere.normalize(gamma + 0.5 * h * rates)
            half_rates = sphere.project(half, rates + 0.5 * h * acceleration(gamma, rates))
            rates = rates + h * acceleration(half, half_rates)
            gamma = sphere.normalize(gamma + h * half_rates)
            rates = sphere.project(gamma, rates)
            fastest = max(fastest, float(np.max(np.sum(rates * rates, axis=-1))))
        errors = np.max(np.abs(measures.pairwise_angles(gamma) - THETA), axis=-1)
        formed = np.count_nonzero((errors < 1e-3) & (np.max(np.abs(rates), axis=(1, 2)) < 1e-3))
        lines.append(f'acceleration limit {name}: {formed} of {starts} random starts at rest in a '
                     f'tetrahedron after {seconds:.0f} s, no body ever faster than '
                     f'{math.sqrt(fastest):.2f} rad/s')
    return '\n'.join(lines)


def momentum():
    """Let a body with wheels tumble for 1e5 steps."""
    lines = []
    for name, integrator in (('RK4', mujoco.mjtIntegrator.mjINT_RK4),
                             ('Euler', mujoco.mjtIntegrator.mjINT_EULER)):
        bodies = make_bodies(rotation.random(np.random.default_rng(0), (1,)), axes(1),
                             Physics('wheels'))
        model, data = bodies._model, bodies._data
        model.opt.integrator, model.opt.timestep = integrator, 1e-3
        bodies._velocities[:, 3:9] = [1.0, -0.7, 0.5, 30.0, -50.0, 40.0]
        before = bodies.angular_momentum()
        mujoco.mj_step(model, data, 100_000)
        drift = np.linalg.norm(bodies.angular_momentum() - before) / np.linalg.norm(before)
        lines.append(f'angular momentum of box and wheels, 1e5 steps of 1 ms, {name}'
                     f'{" (used)" if name == "RK4" else ""}: relative change {drift:.1e}')
    return '\n'.join(lines)


def speed():
    """Measure bodies with mass in processor time: against real time, and MuJoCo's share of it."""
    lines = []
    for body, n in (('wheels', 4), ('gimbal', 4), ('wheels', 32)):
        graph = topology.complete(n)
        rng = np.random.default_rng(0)
        attitudes = rotation.random(rng, (n,))
        loop = loop_of(Physics(body), graph, attitudes)
        spent = [0.0]

        def timed(call, spent=spent):
            def run(*arguments):
                begun = time.process_time()
                call(*arguments)
                spent[0] += time.process_time() - begun
            return run

        names = ('mj_step', 'mj_step1', 'mj_step2', 'mj_fullM')
        before = {name: getattr(mujoco, name) for name in names}
        loop.advance(0.01, 20)
        try:
            for name, call in before.items():
                setattr(mujoco, name, timed(call))
            begun = time.process_time()
            loop.advance(0.01, 300)
            elapsed = time.process_time() - begun
        finally:
            for name, call in before.items():
                setattr(mujoco, name, call)
        lines.append(f'{body}, n = {n}, law and physics at 1 kHz in one process: '
                     f'{3.0 / elapsed:.1f} times real time, MuJoCo '
                     f'{100.0 * spent[0] / elapsed:.0f} % of it')
    return '\n'.join(lines)


def schedule(seconds=30.0):
    """Run plant, agents and monitor in six processes at 100 Hz in real time."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    lines = []
    for body in ('kinematic', 'wheels', 'gimbal'):
        commands = [['plant', '--config', 'rotating', '--ros-args', '-p', 'mode:=realtime',
                     '-p', f'body:={body}'], ['monitor', '--config', 'rotating'],
                    *(['agent', '--config', 'rotating', '--id', str(i)] for i in range(1, 5))]
        started = [subprocess.Popen([sys.executable, '-m', 'tetra_ros2', *command],
                                    stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                   for command in commands]
        context = Context()
        context.init()
        node = Node('schedule', context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        messages = []
        node.create_subscription(PoseArray, 'formation/attitudes', messages.append, 1000)
        try:
            begun = time.monotonic()
            while time.monotonic() - begun < 8.0:
                executor.spin_once(timeout_sec=0.1)
            messages.clear()
            begun = time.monotonic()
            while time.monotonic() - begun < seconds:
                executor.spin_once(timeout_sec=0.1)
        finally:
            for process in started:
                process.send_signal(signal.SIGINT)
            for process in started:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(20)
            leave(executor)
        times = np.array([1e3 * m.header.stamp.sec + 1e-6 * m.header.stamp.nanosec
                          for m in messages])
        times -= times[0]
        grid = np.round(times / 10.0) * 10.0
        late = times - grid
        late -= np.median(late)
        lines.append(f'{body}, six processes, 100 Hz: {len(times)} steps in {seconds:g} s, '
                     f'{100.0 * np.mean(np.abs(late) <= 1.0):.2f} % within 1 ms of schedule, '
                     f'99th percentile {np.percentile(np.abs(late), 99.0):.3f} ms')
    return '\n'.join(lines)


PARTS = {part.__name__: part for part in (
    momentum, speed, schedule, saturation, weak, sides, limit)}


def main():
    """Print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('parts', nargs='*', choices=[[], *PARTS], default=[])
    chosen = parser.parse_args().parts or PARTS
    print(f'{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}')
    for name in chosen:
        print(PARTS[name](), flush=True)


if __name__ == '__main__':
    main()
