# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``python -m benchmarks``."""

import argparse
import sys

from benchmarks import bench
from tetra_ros2.config.parameters import ConfigurationError


def main(argv=None):
    """Measure; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks', description=bench.__doc__)
    bench.add_arguments(parser)
    try:
        return bench.run(parser.parse_args(argv))
    except ConfigurationError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2


if __name__ == '__main__':
    sys.exit(main())
