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
Change the mathematics and the nodes a little, many times, and see the tests fail.

The changes are those of cosmic-ray, and so is the session that keeps what came of them. Mutants
are tried in a random order that the seed decides, so that wherever it is stopped, those that were
tried are a random sample of all. Each is judged by the tests that run the changed statement, the
quickest first, in a process forked off one that has imported everything but this package: that
costs half a second instead of four. What lives is tried again by more tests.

Every so often the same tests are run on the code as it is. Should they fail, mutants were killed
by the machine and not by the tests.
"""

import argparse
import ast
from collections import Counter, defaultdict
import compileall
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import suppress
import difflib
from fnmatch import fnmatch
import hashlib
import itertools
import multiprocessing
import os
from pathlib import Path
import py_compile
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from xml.etree import ElementTree

from cosmic_ray.commands.init import init
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import use_db
from cosmic_ray.work_item import TestOutcome, WorkerOutcome, WorkResult
from coverage import CoverageData
from hypothesis import Phase, settings
import pytest
from tetra_ros2.study.confidence import lower_bound
import yaml

WHERE = Path('mutants')
"""Everything that is made goes here, below the directory of the repository."""

CODE = ('tetra_ros2/formation', 'tetra_ros2/nodes')
"""What is changed."""

JUDGES = (
    'test/formation', 'test/nodes', 'test/drawing', 'test/drivers/test_drivers.py',
    'test/system/test_wire.py', 'test/system/test_intruder.py')
"""The tests that may kill a mutant: those that run the code in the process of the test itself."""

LEFT_OUT = re.compile(
    # `a * b` as `a >> b` is a TypeError for floats, which any test kills.
    r'core/ReplaceBinaryOperator_(Add|Sub|Mul|Div|FloorDiv|Mod|Pow)_'
    r'(RShift|LShift|BitOr|BitAnd|BitXor)$'
    # `==` is `is` for whole numbers up to 256 and for names.
    r'|core/ReplaceComparisonOperator_(Eq_Is|NotEq_IsNot|Is_Eq|IsNot_NotEq)$')
"""Kinds of changes that say nothing about the tests."""

BUDGET, BUDGET_MORE = 10.0, 30.0
"""How long the tests that judge a mutant may seem to take without it, together [s]."""

OWN = 0.2
"""By what factor a test of the module's own file seems quicker: it is the likeliest to fail."""

OF_ALL = 'test/formation/test_values.py::'
"""Tests that look at what modules define, of which they run nothing but the import."""

NEW = 2.0
"""How long a test is thought to take that was not measured [s]."""

PLUGINS = ('_hypothesis_pytestplugin', 'pytest_timeout')
"""The plugins of pytest that the tests want."""

EQUIVALENT = Path(__file__).with_name('equivalent_mutants.yaml')
"""Mutants that do what the code does, each with the reason."""

CONTROL = 20
"""After so many mutants the tests of the last are run on the code as it is."""


def main(argv=None):
    """Try mutants, or report on those tried; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.mutants', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('modules', nargs='*', default=['*'],
                        help='which, as patterns of paths: formation/law.py nodes/* (all)')
    parser.add_argument('--sample', type=int, metavar='N', help='only the first N of the order')
    parser.add_argument('--time', type=float, metavar='S', help='stop after this time [s]')
    parser.add_argument('--seed', type=int, default=1, help='of the order (%(default)s)')
    parser.add_argument('--again', action='store_true',
                        help='try those again that survived, by the tests as they are now')
    parser.add_argument('--jobs', type=int, default=1, help='so many at a time (%(default)s)')
    parser.add_argument('--report', action='store_true', help='only say what came of it')
    arguments = parser.parse_args(argv)
    WHERE.mkdir(exist_ok=True)
    with use_db(WHERE / 'session.sqlite') as session:
        if not arguments.report:
            modules = sorted(p for code in CODE for p in Path(code).glob('*.py'))
            digest = hashlib.sha256(b''.join(p.read_bytes() for p in modules)).hexdigest()
            if session.num_work_items == 0:
                print('listing mutants ...', flush=True)
                init(modules, session, {})
                (WHERE / 'code').write_text(digest)
            elif (WHERE / 'code').read_text() != digest:
                print(f'the code has changed: remove {WHERE}/ to begin anew', file=sys.stderr)
                return 2
            if not (WHERE / 'judges.xml').exists():
                print('measuring which tests run what ...', flush=True)
                measure(copy_of_the_repository('tree'))
            try_mutants(session, arguments)
        report(session, arguments)
    return 0


def copy_of_the_repository(name):
    """Copy what git knows, or would know, to where it may be changed."""
    tree = (WHERE / name).absolute()
    files = subprocess.run(['git', 'ls-files', '-co', '--exclude-standard'], check=True,
                           capture_output=True, text=True).stdout.split('\n')
    for file in filter(os.path.isfile, files):
        target = tree / file
        if not target.exists() or target.read_bytes() != Path(file).read_bytes():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, target)
    # A compiled file is used only if it was made of this very source: times and sizes, which
    # Python looks at otherwise, may be the same for two mutants.
    compileall.compile_dir(tree / 'tetra_ros2', quiet=1, force=True,
                           invalidation_mode=py_compile.PycInvalidationMode.CHECKED_HASH)
    return tree


def measure(tree):
    """Run the tests once, to see which statements each of them runs, and how long it takes."""
    environment = os.environ | {'PYTHONPATH': str(tree), 'OPENBLAS_NUM_THREADS': '1'}
    outcome = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '--no-header', '-p', 'no:cacheprovider',
         '--cov', '--cov-context=test', '--cov-report=', '--junitxml=judges.xml', *JUDGES],
        cwd=tree, env=environment, check=False, stdout=(WHERE / 'judges.log').open('w'),
        stderr=subprocess.STDOUT).returncode
    if outcome != 0:
        print(f'Some tests fail as it is, and are not asked: see {WHERE / "judges.log"}')
    for name in ('.coverage', 'judges.xml'):
        shutil.copyfile(tree / name, WHERE / name)


class Judges:
    """
    Which tests are to judge a mutant.

    :param tree: where they are; those that were measured and are there no more are left out
    """

    def __init__(self, tree):
        self._there = set(subprocess.run(
            [sys.executable, '-m', 'pytest', '--collect-only', '-q', '-p', 'no:cacheprovider',
             *JUDGES], cwd=tree, env=os.environ | {'PYTHONPATH': str(tree)}, check=True,
            capture_output=True, text=True).stdout.split('\n'))
        self._seconds = {}
        for case in ElementTree.parse(WHERE / 'judges.xml').iter('testcase'):
            test = f'{case.get("classname").replace(".", "/")}.py::{case.get("name")}'
            if test in self._there and case.find('failure') is None and case.find('error') is None:
                self._seconds[test] = float(case.get('time'))
        self._data = CoverageData(WHERE / '.coverage')
        self._data.read()
        self._lines = {}

    def of(self, path, line, more=False, but=()):
        """
        Return tests that run a statement, the quickest first.

        :param more: more of them, and all in the module's own file of tests: what numba compiles
            is not seen to be run, and what is new has not been measured
        :param but: leave out these
        """
        own = Path('test', *path.parts[1:-1], f'test_{path.name.lstrip("_")}')
        first, last = statement(path, line)
        tests = self._of_lines(path, first, last)
        if not tests and self._is_run_at_import(path, first, last):
            tests = self._of_lines(path, 1, 10**6)
            tests |= {test for test in self._there if test.startswith(OF_ALL)}
        if more:
            tests |= {test for test in self._there if test.startswith(f'{own}::')}

        def seconds(test):
            return self._seconds.get(test, NEW) * (OWN if test.startswith(f'{own}::') else 1.0)

        chosen, total = [], 0.0
        for test in sorted(tests - set(but), key=seconds):
            total += seconds(test)
            if chosen and total > (BUDGET_MORE if more else BUDGET):
                break
            chosen.append(test)
        return chosen

    def _contexts(self, path):
        """Return in which contexts each line of a module was run."""
        if path not in self._lines:
            measured = [f for f in self._data.measured_files() if f.endswith(str(path))]
            self._lines[path] = self._data.contexts_by_lineno(measured[0]) if measured else {}
        return self._lines[path]

    def _of_lines(self, path, first, last):
        return {test for line, contexts in self._contexts(path).items() if first <= line <= last
                for context in contexts if (test := context.partition('|')[0]) in self._seconds}

    def _is_run_at_import(self, path, first, last):
        return any('' in contexts for line, contexts in self._contexts(path).items()
                   if first <= line <= last)

    def seconds(self, tests):
        """Return how long each of them took [s]."""
        return {test: self._seconds.get(test, NEW) for test in tests}


def statement(path, line):
    """Return the first and the last line of the statement of which a line is part."""
    first, last = 1, 0
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.stmt):
            continue
        decorators = getattr(node, 'decorator_list', [])
        begin = min([node.lineno, *(d.lineno for d in decorators)])
        if begin <= line <= node.end_lineno and begin >= first:
            body = getattr(node, 'body', None)
            whole = not body or isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
            # Of `if x:` only the first line is run wherever x is; of a function its body tells.
            first, last = begin, node.end_lineno if whole else body[0].lineno - 1
    return first, last


def annotations(path):
    """Return where in a module annotations begin and end, as (line, column) both."""
    spans = []
    for node in ast.walk(ast.parse(path.read_text())):
        for name in ('annotation', 'returns'):
            if (found := getattr(node, name, None)) is not None:
                spans.append(((found.lineno, found.col_offset),
                              (found.end_lineno, found.end_col_offset)))
    return spans


def mutants_in_order(session, arguments):
    """Return the mutants that say something about the tests, as seed and sample have them."""
    items = list(session.work_items)
    spans = {path: annotations(path) for path in {i.mutations[0].module_path for i in items}}
    items = sorted(
        (item for item in items if not LEFT_OUT.match((m := item.mutations[0]).operator_name)
         and not any(first <= tuple(m.start_pos) < last for first, last in spans[m.module_path])),
        key=lambda item: (str(item.mutations[0].module_path), item.mutations[0].operator_name,
                          item.mutations[0].occurrence))
    random.Random(arguments.seed).shuffle(items)
    return [item for item in items[:arguments.sample] if chosen(item, arguments.modules)]


def try_mutants(session, arguments):
    """Try mutants until the time is up or there are enough."""
    done = dict(session.results)
    items = [item for item in mutants_in_order(session, arguments) if (
        is_survivor(done.get(item.job_id)) if arguments.again else item.job_id not in done)]
    import_what_tests_want()
    trees = multiprocessing.SimpleQueue()
    for k in range(arguments.jobs):
        trees.put(f'tree{k}')
    end = time.monotonic() + (arguments.time or float('inf'))
    with ProcessPoolExecutor(arguments.jobs, multiprocessing.get_context('fork'), Worker.begin,
                             (trees, arguments.again)) as pool:
        # Given out one by one, so that those that were tried are the first of the order.
        waiting = iter(items)
        pending = {pool.submit(Worker.judge, i) for i in itertools.islice(waiting, arguments.jobs)}
        count = 0
        while pending:
            ready, pending = wait(pending, return_when=FIRST_COMPLETED)
            for item, result in (future.result() for future in ready):
                session.set_result(item.job_id, result)
                count += 1
                mutation = item.mutations[0]
                print(f'{count}/{len(items)} {result.test_outcome.value} {mutation.module_path}:'
                      f'{mutation.start_pos[0]} {(result.output or "").strip()[-150:]!r}',
                      flush=True)
            if time.monotonic() < end:
                pending |= {pool.submit(Worker.judge, i)
                            for i in itertools.islice(waiting, len(ready))}


class Worker:
    """A process that judges mutants in a copy of the repository of its own."""

    @classmethod
    def begin(cls, trees, again):
        cls.tree, cls.again, cls.count = copy_of_the_repository(trees.get()), again, 0
        cls.judges = Judges(cls.tree)  # not before it is forked: coverage would have none of it

    @classmethod
    def judge(cls, item):
        mutation = item.mutations[0]
        at = mutation.module_path, mutation.start_pos[0]
        tests = cls.judges.of(*at, more=cls.again)
        seconds = cls.judges.seconds(tests)
        result = judge(cls.tree, mutation, tests, seconds)
        if is_survivor(result) and not cls.again and (
                others := cls.judges.of(*at, more=True, but=tests)):
            result = judge(cls.tree, mutation, others, cls.judges.seconds(others))
        cls.count += 1
        if cls.count % CONTROL == 0:
            killer = run(cls.tree, tests, seconds)
            with (WHERE / 'controls.log').open('a') as file:
                print(f'{mutation.module_path}:{mutation.start_pos[0]} {killer!r}', file=file)
        return item, result


def chosen(item, patterns):
    """Return whether a mutant is of one of these modules."""
    return any(fnmatch(str(item.mutations[0].module_path), f'*{pattern}') for pattern in patterns)


def is_survivor(result):
    """Return whether a mutant was tried and lived."""
    return result is not None and result.test_outcome == TestOutcome.SURVIVED


def judge(tree, mutation, tests, seconds):
    """Run the tests on a mutant."""
    path = tree / mutation.module_path
    code = path.read_text()
    mutant = mutate_code(
        code, get_operator(mutation.operator_name)(**mutation.operator_args), mutation.occurrence)
    diff = '\n'.join(line for line in difflib.unified_diff(
        code.split('\n'), mutant.split('\n'), n=0, lineterm='') if line[:3] not in ('---', '+++'))
    try:
        compile(mutant, path, 'exec')
    except SyntaxError:  # as of the star of keyword-only parameters
        return WorkResult(worker_outcome=WorkerOutcome.NORMAL, diff=diff,
                          test_outcome=TestOutcome.INCOMPETENT)
    try:
        path.write_text(mutant)
        killer = run(tree, tests, seconds) if tests else None
    finally:
        path.write_text(code)
    return WorkResult(
        worker_outcome=WorkerOutcome.NORMAL if tests else WorkerOutcome.NO_TEST, diff=diff,
        test_outcome=TestOutcome.KILLED if killer else TestOutcome.SURVIVED, output=killer)


def run(tree, tests, seconds):
    """Run tests in a process of their own; return which one failed, or None."""
    log = tree.with_name(f'{tree.name}.killer')
    log.unlink(missing_ok=True)
    process = multiprocessing.get_context('fork').Process(
        target=_child, args=(tree, tests, log, seconds))
    process.start()
    # Time on a processor tells a loop without end; the clock tells a wait for nothing.
    process.join(120.0 + 30.0 * sum(seconds.values()))
    timed_out = process.exitcode in (None, -signal.SIGXCPU)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)  # and whatever it started
    process.join()
    if timed_out:
        return 'timeout'
    if process.exitcode == 0:
        return None
    if log.exists():
        return log.read_text()
    output = tree.with_name(f'{tree.name}.output').read_text(errors='replace')
    if 'ERROR: not found' in output:  # that is no verdict
        raise RuntimeError(output)
    return f'exit status {process.exitcode}'


def _child(tree, tests, log, seconds):
    os.setsid()
    output = os.open(tree.with_name(f'{tree.name}.output'), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.chdir(tree)
    os.environ['PYTHONPATH'] = str(tree)
    for name in [name for name in sys.modules if name.partition('.')[0] == 'tetra_ros2']:
        del sys.modules[name]
    sys.path = [str(tree), *(p for p in sys.path if p not in ('', str(tree.parent.parent)))]
    sys.dont_write_bytecode = True

    class Killer:

        @staticmethod
        def pytest_runtest_logstart(nodeid):
            limit = time.process_time() + 10.0 + 3.0 * seconds.get(nodeid, NEW)
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit), resource.RLIM_INFINITY))

        @staticmethod
        def pytest_runtest_logreport(report):
            if report.failed:
                log.write_text(report.nodeid)

        @staticmethod
        def pytest_collectreport(report):
            if report.failed:
                log.write_text(f'{report.nodeid}: not even imported')

    os.environ['PYTEST_DISABLE_PLUGIN_AUTOLOAD'] = '1'  # to look for them takes long
    status = pytest.main(['-x', '-q', '--tb=line', '--no-header', '-p', 'no:cacheprovider',
                          *(f'-p{name}' for name in PLUGINS), '--timeout=0',
                          '--hypothesis-profile=mutants', *tests], plugins=[Killer])
    os._exit(int(status))


def import_what_tests_want():
    """Import what takes long, so that a forked process has it."""
    os.environ['OPENBLAS_NUM_THREADS'] = '1'
    for name in ('hypothesis.extra.numpy', 'numpy', 'scipy.optimize', 'scipy.linalg',
                 'scipy.integrate', 'scipy.spatial.transform', 'numba', 'yaml', 'rich.table',
                 'rclpy', 'rclpy.executors', 'geometry_msgs.msg', 'diagnostic_msgs.msg',
                 'std_srvs.srv', 'visualization_msgs.msg', 'tf2_msgs.msg', *PLUGINS):
        with suppress(ImportError):
            __import__(name)
    # The examples are those of the suite; a failure need not be made small.
    settings.register_profile('mutants', derandomize=True, deadline=None, max_examples=30,
                              phases=[Phase.explicit, Phase.generate])


def report(session, arguments):
    """Say how many mutants the tests kill, and which they do not."""
    equivalent = {(e['module'], _plain(e['code']), _plain(e['mutant'])): e['why']
                  for e in yaml.safe_load(EQUIVALENT.read_text()) or []}
    rows, survivors = defaultdict(Counter), []
    items, done = mutants_in_order(session, arguments), dict(session.results)
    population = Counter(str(item.mutations[0].module_path) for item in items)
    for item in items:
        if (result := done.get(item.job_id)) is None \
                or result.test_outcome == TestOutcome.INCOMPETENT:
            continue
        mutation = item.mutations[0]
        module = str(mutation.module_path)
        if not is_survivor(result):
            what = 'timeout' if result.output == 'timeout' else 'killed'
        elif (module, *changed(result.diff)) in equivalent:
            what = 'equivalent'
        else:
            what = 'survived'
            survivors.append((module, mutation.start_pos[0], result))
        rows[module][what] += 1
    total = sum(rows.values(), Counter())
    print(f'{"module":40} {"mutants":>8} {"tried":>6} {"killed":>7} {"timeout":>8} '
          f'{"equivalent":>11} {"survived":>9}')
    for module in [*sorted(population), 'all']:
        row = total if module == 'all' else rows[module]
        print(f'{module:40} {population[module] or sum(population.values()):8} '
              f'{sum(row.values()):6} {row["killed"]:7} {row["timeout"]:8} '
              f'{row["equivalent"]:11} {row["survived"]:9}')
    for module, line, result in sorted(survivors, key=lambda s: s[:2]):
        reached = '' if result.worker_outcome == WorkerOutcome.NORMAL else ' (no test runs it)'
        print(f'\n{module}:{line} survives{reached}\n{result.diff}')
    killed = total['killed'] + total['timeout']
    counted = killed + total['survived']
    if counted:
        low = lower_bound(killed, counted, 0.975)
        high = 1.0 - lower_bound(counted - killed, counted, 0.975)
        print(f'\n{killed} of {counted} that are not equivalent were killed: '
              f'{killed / counted:.1%}, of all with 95 % confidence {low:.1%} to {high:.1%}')


def changed(diff):
    """Return the lines that a diff takes away, and those that it puts in their place."""
    lines = diff.split('\n')
    return (_plain(' '.join(line[1:] for line in lines if line.startswith('-'))),
            _plain(' '.join(line[1:] for line in lines if line.startswith('+'))))


def _plain(code):
    return ''.join(code.split())


if __name__ == '__main__':
    sys.exit(main())
