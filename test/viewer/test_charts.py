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

"""What is drawn beside the error: the slope that theory predicts, where it predicts one."""

import numpy as np
import pytest
from tetra_ros2.viewer.charts import slope

TIMES = np.linspace(0.0, 20.0, 401)


@pytest.mark.parametrize('rate', [0.5, 1.0, 1.5])
def test_the_predicted_slope_begins_a_tenth_of_a_radian_from_the_shape(rate):
    error = np.exp(-rate * TIMES)
    line = slope(TIMES, error, rate)
    beside = line != error
    assert np.array_equal(np.flatnonzero(beside)[0], np.flatnonzero(error <= 0.1)[0])
    assert np.all(beside[error <= 0.1])
    np.testing.assert_allclose(np.gradient(np.log(line[beside]), TIMES[beside]), -rate, rtol=1e-9)
    np.testing.assert_allclose(line[beside], 2.0 * error[beside], rtol=1e-9)


def test_there_is_no_slope_beside_an_error_that_does_not_decay_or_whose_rate_is_not_known():
    decaying, small = np.exp(-TIMES), np.full_like(TIMES, 1e-3)
    assert np.array_equal(slope(TIMES, decaying, None), decaying)
    assert np.array_equal(slope(TIMES, small, 1.0), small)
    assert np.array_equal(slope(TIMES, np.full_like(TIMES, 0.5), 1.0), np.full_like(TIMES, 0.5))
