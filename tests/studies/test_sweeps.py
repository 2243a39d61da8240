import json
import math
import os
import signal
import subprocess
import sys
import threading
from collections import Counter
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from queue import SimpleQueue

import numpy as np
import pytest

from stickslip.studies import sweeps
from stickslip.studies.sweeps import SweepInterrupted, sweep

GRID = {"a": [1.0, 2.0, 3.0], "b": np.array([0.1, 0.2])}


def product_of(a, b):
    return a * b


def several(a, b):
    return {"sum": a + b, "pair": [a / 3, math.sqrt(b)]}


def moody(a, b):
    if a == 2.0:
        raise ValueError(f"no {a} with {b}")
    return a * b


def deadly(a):
    if a == 2:
        os._exit(7)
    return 10.0 * a


class Counting:
    """A function that remembers the points it was called with."""

    def __init__(self, function):
        self.function = function
        self.calls = []

    def __call__(self, **point):
        self.calls.append(tuple(point.values()))
        return self.function(**point)


def serial(function, grid=GRID, **options):
    return sweep(function, grid, executor="serial", progress=False, **options)


def same(one, other):
    assert one.values.keys() == other.values.keys()
    for name in one.values:
        np.testing.assert_array_equal(one.values[name], other.values[name])
    assert one.failures == other.failures
    assert one.pending == other.pending


def test_every_combination_once_in_order_the_last_parameter_fastest():
    function = Counting(product_of)
    result = serial(function)
    assert function.calls == [(1.0, 0.1), (1.0, 0.2), (2.0, 0.1), (2.0, 0.2), (3.0, 0.1), (3.0, 0.2)]
    assert result.shape == (3, 2)
    np.testing.assert_array_equal(result.value(), np.outer([1.0, 2.0, 3.0], [0.1, 0.2]))
    assert not result.failures
    assert not result.pending


def test_several_values_and_small_arrays():
    result = serial(several)
    assert {name: array.shape for name, array in result.values.items()} == {"sum": (3, 2), "pair": (3, 2, 2)}
    assert result.values["pair"][1, 0].tolist() == [2.0 / 3, math.sqrt(0.1)]
    with pytest.raises(ValueError, match="choose from sum, pair"):
        result.value()
    with pytest.raises(ValueError, match="no value 'x'"):
        result.value("x")


def test_points_iterates_parameters_and_values():
    points = list(serial(several).points())
    assert len(points) == 6
    point, values = points[3]
    assert point == {"a": 2.0, "b": 0.2}
    assert values["sum"] == 2.2
    assert values["pair"].tolist() == [2.0 / 3, math.sqrt(0.2)]


def test_the_function_gets_plain_values_of_any_kind():
    seen = []
    grid = {"n": np.arange(2), "name": ["x", "y"], "on": [True, False], "law": [None, (1, 2)], "m": [1, 2.5]}
    result = serial(lambda **point: seen.append(point) or 1.0, grid)
    assert seen[0] == {"n": 0, "name": "x", "on": True, "law": None, "m": 1.0}
    assert [type(value) for value in seen[-1].values()] == [int, str, bool, tuple, float]
    assert result.parameters["n"].dtype.kind == "i"
    assert result.parameters["law"].dtype == object
    assert [point for point, _ in result.points()] == seen


def test_failures_are_recorded_and_the_rest_is_kept():
    result = serial(moody)
    assert result.failures == {(1, 0): "ValueError: no 2.0 with 0.1", (1, 1): "ValueError: no 2.0 with 0.2"}
    assert np.isnan(result.value()[1]).all()
    assert result.value()[2, 1] == 3.0 * 0.2
    assert "6 points: 2 failed, 0 pending" in str(result)
    assert "failed at a=2.0, b=0.1: ValueError: no 2.0 with 0.1" in str(result)
    assert repr(result) == str(result)


def test_all_points_failing_still_gives_a_result():
    result = serial(lambda a, b: 1 / 0)
    assert np.isnan(result.value()).all()
    assert len(result.failures) == 6
    assert "and 3 more in .failures" in str(result)


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        (None, "TypeError: the function returned value of type NoneType; return numbers"),
        ("1.0", "TypeError: the function returned value of type str; return numbers"),
        (1j, "TypeError: the function returned value of type complex; return numbers"),
        ({}, "ValueError: the function returned no value; return at least one"),
        ({"a": 1.0}, "ValueError: the function names a value 'a'; take a text that is no parameter"),
        ({3: 1.0}, "ValueError: the function names a value 3; take a text that is no parameter"),
    ],
)
def test_what_is_not_a_number_is_a_failure(returned, message):
    assert serial(lambda a: returned, {"a": [1]}).failures == {(0,): message}


def test_values_must_keep_their_names_and_shapes():
    result = serial(lambda a: {"v": np.zeros(a)}, {"a": [2, 3, 2]} | {"a": [2, 3]})
    assert result.values["v"].shape == (2, 2)
    assert list(result.failures) == [(1,)]
    assert "{'v': (3,)}, before {'v': (2,)}" in result.failures[1,]


def test_exit_of_a_point_is_a_failure():
    assert serial(lambda a: sys.exit(3), {"a": [1]}).failures == {(0,): "SystemExit: 3"}


@pytest.mark.parametrize(
    ("grid", "options", "kind", "message"),
    [
        ({}, {}, TypeError, "grid must map parameter names to values"),
        ([1, 2], {}, TypeError, r"got \[1, 2\]"),
        ({"a": []}, {}, ValueError, r"grid\['a'\] is empty; give at least one value"),
        ({"a": 3}, {}, TypeError, r"grid\['a'\] must be a sequence of values, got 3; write \[3\]"),
        ({"a": "merged"}, {}, TypeError, r"write \['merged'\]"),
        ({"a": {1, 2}}, {}, TypeError, "must be a sequence"),
        ({"a": np.zeros((2, 2))}, {}, ValueError, "must have one dimension, not 2; ravel it"),
        ({"a": [1, 2, 1]}, {}, ValueError, "a value twice, leave one out"),
        ({1: [1]}, {}, TypeError, "parameter names must be texts, got 1"),
        ({"a": [1]}, {"executor": "threads"}, TypeError, "executor must be an Executor, 'serial' or None"),
        ({"a": [1]}, {"workers": 0}, ValueError, "workers must be a whole number from 1 on, got 0"),
        ({"a": [1]}, {"workers": 2, "executor": "serial"}, ValueError, "leave out executor or workers"),
        ({"a": [1j]}, {"save": "never"}, TypeError, "save needs parameters that are numbers or texts"),
    ],
)
def test_bad_arguments_are_refused(grid, options, kind, message):
    with pytest.raises(kind, match=message):
        sweep(product_of, grid, progress=False, **options)


def test_function_must_be_callable():
    with pytest.raises(TypeError, match="function must be callable, got 3"):
        sweep(3, GRID)


# executors


@pytest.mark.slow
def test_processes_give_the_same_as_serial():
    same(sweep(moody, GRID, workers=2, progress=False), serial(moody))


def test_threads_give_the_same_as_serial_and_stay_open():
    with ThreadPoolExecutor(3) as threads:
        same(sweep(several, GRID, executor=threads, progress=False), serial(several))
        assert threads.submit(len, "open").result() == 4


@pytest.mark.slow
def test_dask_gives_the_same_as_serial():
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 1, "threads_per_worker": 2, "processes": False, "dashboard_address": "127.0.0.1:0"}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        executor = client.get_executor(pure=False)
        same(sweep(moody, GRID, executor=executor, progress=False), serial(moody))
        same(sweep(several, GRID, executor=executor, progress=False), serial(several))


@pytest.mark.slow
def test_a_point_that_kills_its_process_is_found_and_the_others_are_kept():
    result = sweep(deadly, {"a": [1, 2, 3, 4]}, workers=1, progress=False)
    assert list(result.failures) == [(1,)]
    assert result.failures[1,].startswith("BrokenProcessPool: ")
    np.testing.assert_array_equal(result.value(), [10.0, np.nan, 30.0, 40.0])


class KilledWorker(Exception):
    """The error of dask for points whose workers died too often."""

    __module__ = "distributed.scheduler"


class OneWorker(Executor):
    """An executor that begins only when its points are waited for; a deadly point takes all waiting points with it."""

    def __init__(self):
        self.waiting = []
        self.together = []

    def submit(self, function, *args):
        future = Future()
        self.waiting.append((future, function, args))
        return future

    def run(self):
        self.together.append(len(self.waiting))
        dies = any(args[1]["a"] == 2 for _, _, args in self.waiting)
        waiting, self.waiting = self.waiting, []
        for future, function, args in waiting:
            if dies:
                future.set_exception(KilledWorker("attempted 3 times"))
            else:
                future.set_result(function(*args))


def test_a_point_that_kills_a_worker_of_dask_takes_no_other_with_it(monkeypatch):
    executor = OneWorker()

    class Waiting(SimpleQueue):
        def get(self):
            if self.empty():
                executor.run()
            return super().get()

    monkeypatch.setattr(sweeps, "SimpleQueue", Waiting)
    monkeypatch.setattr(sweeps, "_WINDOW", 2)
    result = sweep(abs_of_a, {"a": [1, 2, 3, 4]}, executor=executor, progress=False)
    assert list(result.failures) == [(1,)]
    assert result.failures[1,].startswith("KilledWorker: ")
    np.testing.assert_array_equal(result.value(), [1.0, np.nan, 3.0, 4.0])
    assert executor.together[:2] == [2, 2]
    assert executor.together[2:] == [1, 1]  # the two that died, each alone


ORPHANS = """
import os, sys, time
from stickslip.studies.sweeps import sweep

def never_ends(a):
    print(os.getpid(), flush=True)
    while True:
        time.sleep(0.01)

if __name__ == "__main__":
    sweep(never_ends, {"a": [1, 2, 3, 4]}, workers=2, progress=False)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("end", ["SIGTERM", "SIGKILL"])
def test_workers_end_when_their_parent_is_ended(tmp_path, end):
    script = tmp_path / "orphans.py"
    script.write_text(ORPHANS)
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as parent:
        workers = [int(parent.stdout.readline()) for _ in range(2)]
        parent.send_signal(getattr(signal, end))
        # every process alive holds the pipe open: it closes when the last worker has ended
        try:
            parent.communicate(timeout=600)
        except subprocess.TimeoutExpired:
            for worker in workers:
                os.kill(worker, signal.SIGKILL)
            pytest.fail("the workers went on without their parent")


def test_a_function_that_other_processes_cannot_load_is_refused():
    with pytest.raises(TypeError, match=r"cannot be handed to other processes.*executor='serial'"):
        sweep(lambda a: a, {"a": [1, 2]}, workers=1, progress=False)


class Counted:
    """Keeps count of the points on their way in an executor."""

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        self.lock = threading.Lock()
        self.submitted = self.on_their_way = self.most = 0

    def submit(self, *args):
        with self.lock:
            self.submitted += 1
            self.on_their_way += 1
            self.most = max(self.most, self.on_their_way)
        future = super().submit(*args)
        future.add_done_callback(self._back)
        return future

    def _back(self, _):
        with self.lock:
            self.on_their_way -= 1


class CountedThreads(Counted, ThreadPoolExecutor):
    pass


class CountedProcesses(Counted, ProcessPoolExecutor):
    pass


def test_only_a_window_of_points_is_submitted_at_a_time(monkeypatch):
    monkeypatch.setattr(sweeps, "_WINDOW", 5)
    with CountedThreads(2) as executor:
        result = sweep(abs_of, {"x": np.arange(300)}, executor=executor, progress=False)
    assert executor.submitted == 300
    assert executor.most <= 5
    np.testing.assert_array_equal(result.value(), np.arange(300))


@pytest.mark.slow
def test_own_processes_get_two_points_each_at_a_time(monkeypatch):
    pools = []

    def counted(*args, **options):
        pools.append(CountedProcesses(*args, **options))
        return pools[-1]

    monkeypatch.setattr(sweeps, "ProcessPoolExecutor", counted)
    result = sweep(abs_of, {"x": np.arange(100)}, workers=1, progress=False)
    (pool,) = pools
    assert pool.submitted == 101  # the points, and the check that the function can be loaded
    assert pool.most <= 2
    np.testing.assert_array_equal(result.value(), np.arange(100))


def abs_of(x):
    return abs(x)


def test_many_points():
    result = serial(abs_of, {"x": np.arange(20_000)})
    assert result.value().sum() == 20_000 * 19_999 / 2


def test_progress_bar_only_on_request(capsys):
    serial(product_of)
    assert capsys.readouterr().err == ""
    sweep(moody, GRID, executor="serial")
    shown = capsys.readouterr().err
    assert "6/6" in shown
    assert "failed=2" in shown


# interrupts


def test_interrupt_keeps_what_was_computed():
    def function(a):
        if a == 3:
            raise KeyboardInterrupt
        return 10.0 * a

    with pytest.raises(SweepInterrupted, match="2 points pending") as caught:
        serial(function, {"a": [1, 2, 3, 4]})
    result = caught.value.result
    np.testing.assert_array_equal(result.value(), [10.0, 20.0, np.nan, np.nan])
    assert result.pending == ((2,), (3,))
    assert not result.failures
    assert isinstance(caught.value, KeyboardInterrupt)


class InterruptedQueue(SimpleQueue):
    """A queue at which Ctrl-C is pressed instead of the third answer.

    A real signal may arrive while a callback of the garbage collector runs, where Python swallows it.
    """

    def __init__(self):
        super().__init__()
        self.answers = 0

    def get(self):
        self.answers += 1
        if self.answers == 3:
            raise KeyboardInterrupt
        return super().get()


def test_interrupt_cancels_the_points_that_have_not_begun(monkeypatch):
    monkeypatch.setattr(sweeps, "SimpleQueue", InterruptedQueue)
    begun = []

    def function(a):
        begun.append(a)
        if len(begun) > 2:
            interrupted.wait()
        return 10.0 * a

    interrupted = threading.Event()
    with ThreadPoolExecutor(1) as threads:
        with pytest.raises(SweepInterrupted) as caught:
            sweep(function, {"a": np.arange(1, 500)}, executor=threads, progress=False)
        interrupted.set()
    result = caught.value.result
    assert len(begun) <= 3
    assert result.value()[:2].tolist() == [10.0, 20.0]
    assert len(result.pending) >= 499 - len(begun)
    assert not result.failures


INTERRUPTED_SWEEP = """
import os, signal, sys, time
from stickslip.studies.sweeps import SweepInterrupted, sweep

def interrupts_parent(a):
    if a == 3:
        os.kill(os.getppid(), signal.SIGINT)
        time.sleep(0.5)
    return float(a)

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        sweep(interrupts_parent, {"a": list(range(1, 200))}, workers=1, progress=False, save=sys.argv[1])
    except SweepInterrupted as stopped:
        print(*stopped.result.value()[:2], len(stopped.result.pending))
"""


@pytest.mark.slow
def test_interrupt_of_processes_keeps_results_and_the_file_resumes(tmp_path):
    script, path = tmp_path / "interrupted.py", tmp_path / "sweep.jsonl"
    script.write_text(INTERRUPTED_SWEEP)
    run = subprocess.run([sys.executable, script, path], capture_output=True, text=True, timeout=600, check=True)
    first, second, pending = map(float, run.stdout.split())
    # two points are under way at once: the one before the interrupting one may not have come back yet
    assert first == 1.0
    assert second == 2.0 or np.isnan(second)
    assert pending > 150
    function = Counting(abs_of_a)
    resumed = serial(function, {"a": list(range(1, 200))}, save=path)
    assert len(function.calls) <= pending + 1
    assert (1,) not in set(function.calls)
    np.testing.assert_array_equal(resumed.value(), np.arange(1, 200))


def abs_of_a(a):
    return abs(a)


# files


def test_saved_lines_hold_parameters_and_values(tmp_path):
    path = tmp_path / "sweep.jsonl"
    serial(moody, save=path)
    records = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    assert len(records) == 6
    assert records[1]["point"] == {"a": 1.0, "b": 0.2}
    assert records[1]["values"] == {"value": 0.2}
    assert records[2]["failure"] == "ValueError: no 2.0 with 0.1"
    assert "values" not in records[2]


def test_each_point_is_on_disk_before_the_next_begins(tmp_path):
    path = tmp_path / "sweep.jsonl"
    lines = []

    def function(a):
        lines.append(path.read_bytes().count(b"\n"))
        return a

    serial(function, {"a": [1, 2, 3]}, save=path)
    assert lines == [0, 1, 2]


def test_resume_computes_nothing_twice_and_tries_failures_again(tmp_path):
    path = tmp_path / "sweep.jsonl"
    serial(moody, save=path)
    mended = Counting(product_of)
    result = serial(mended, save=path)
    assert mended.calls == [(2.0, 0.1), (2.0, 0.2)]
    same(result, serial(product_of))
    again = Counting(product_of)
    same(serial(again, save=path), result)
    assert again.calls == []


def test_saved_numbers_come_back_exactly(tmp_path):
    path = tmp_path / "sweep.jsonl"

    def function(x):
        return {"third": x / 3, "odd": [math.inf, -math.inf, math.nan, 5e-324]}

    first = serial(function, {"x": [1, 2, 1e300]}, save=path)
    same(serial(lambda x: 1 / 0, {"x": [1, 2, 1e300]}, save=path), first)


def test_a_torn_last_line_is_computed_again_wherever_it_was_cut(tmp_path):
    path = tmp_path / "sweep.jsonl"
    expected = serial(product_of, save=path)
    whole = path.read_bytes()
    last = len(whole.splitlines(keepends=True)[-1])
    for cut in range(1, last):
        path.write_bytes(whole[:-cut])
        function = Counting(product_of)
        same(serial(function, save=path), expected)
        assert function.calls == [(3.0, 0.2)]
        assert path.read_bytes() == whole


@pytest.mark.parametrize(
    "other",
    [
        {"a": [1.0, 2.0, 3.0], "c": [0.1, 0.2]},
        {"a": [1.0, 2.0, 3.0], "b": [0.1, 0.2, 0.3]},
        {"a": [1.0, 2.0, 3.0], "b": [0.1, 0.25]},
    ],
)
def test_a_file_of_another_grid_is_refused_and_left_alone(tmp_path, other):
    path = tmp_path / "sweep.jsonl"
    serial(product_of, save=path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match=r"does not belong to this sweep of a, .*Give another file"):
        serial(lambda **point: 1.0, other, save=path)
    assert path.read_bytes() == before


def test_a_file_of_another_version_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "sweep.jsonl"
    first = serial(product_of, save=path, version="one")
    before = path.read_bytes()
    with pytest.raises(ValueError, match=r"saved of another function \(scene, time span, options\)"):
        serial(product_of, save=path, version="two")
    assert path.read_bytes() == before
    same(serial(product_of, save=path, version="one"), first)
    assert path.read_bytes() == before
    with pytest.raises(TypeError, match="version must be a text, got 1"):
        serial(product_of, save=path, version=1)


@pytest.mark.parametrize("text", ["a,b,value\n1,2,3\n", "notes without an end", "\n", "{}\n"])
def test_a_file_that_is_no_sweep_is_refused_and_left_alone(tmp_path, text):
    path = tmp_path / "notes.txt"
    path.write_bytes(text.encode())
    with pytest.raises(ValueError, match="does not belong"):
        serial(product_of, save=path)
    assert path.read_bytes() == text.encode()


@pytest.mark.slow
def test_processes_resume_too(tmp_path):
    path = tmp_path / "sweep.jsonl"
    first = serial(moody, save=path)
    resumed = sweep(moody, GRID, workers=1, progress=False, save=path)
    same(resumed, first)
    count = Counter("failure" in json.loads(line) for line in path.read_text(encoding="utf-8").splitlines())
    assert count == {False: 4, True: 4}


# views


@pytest.mark.slow
def test_xarray_has_coordinates_and_inner_dimensions():
    pytest.importorskip("xarray")
    data = serial(several).to_xarray()
    assert data["sum"].dims == ("a", "b")
    assert data["pair"].dims == ("a", "b", "pair_0")
    assert float(data["sum"].sel(a=2.0, b=0.2)) == 2.2


def test_inner_dimensions_are_none_of_the_parameters():
    pytest.importorskip("xarray")
    found = sweep(lambda v_0: {"v": [v_0, 2.0 * v_0]}, {"v_0": [1.0, 3.0]}, executor="serial", progress=False)
    data = found.to_xarray()
    assert data["v"].dims == ("v_0", "v_0_")
    np.testing.assert_array_equal(data["v"].sel(v_0=3.0), [3.0, 6.0])


def test_xarray_missing_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ImportError, match=r"stickslip\[frames\]"):
        serial(product_of).to_xarray()


@pytest.fixture
def axes():
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    yield plt.subplots()[1]
    plt.close("all")


@pytest.mark.slow
def test_map_shows_the_values_with_x_across_and_marks_missing_points(axes):
    from stickslip.plots import sweep_map

    result = serial(moody, {"a": [1.0, 2.0, 3.0], "b": [0.1, 1.0, 10.0, 100.0]})
    assert sweep_map(result, "a", "b", ax=axes, labels={"a": "a / m", "value": "force / N"}) is axes
    (mesh,) = axes.collections
    np.testing.assert_array_equal(mesh.get_array().filled(np.nan), result.value().T)
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "log")
    assert axes.get_xlabel() == "a / m"
    assert axes.figure.axes[1].get_ylabel() == "force / N"
    (crosses,) = axes.get_lines()
    assert set(crosses.get_xdata()) == {2.0}
    np.testing.assert_allclose(sorted(crosses.get_ydata()), [0.1, 1.0, 10.0, 100.0])
    axes.figure.canvas.draw()


def test_map_sets_texts_side_by_side_and_drops_single_values(axes):
    from stickslip.plots import sweep_map

    grid = {"kind": ["x", "y"], "fixed": [7], "n": [1, 2, 3]}
    result = serial(lambda kind, fixed, n: n + fixed * (kind == "y"), grid)
    sweep_map(result, "kind", "n", ax=axes)
    (mesh,) = axes.collections
    np.testing.assert_array_equal(mesh.get_array(), [[1, 8], [2, 9], [3, 10]])
    assert [label.get_text() for label in axes.get_xticklabels()] == ["x", "y"]


def test_map_refuses_what_it_cannot_draw():
    from stickslip.plots import sweep_map

    result = serial(several)
    with pytest.raises(ValueError, match="no parameter 'c'; choose from a, b"):
        sweep_map(result, "a", "c", "sum")
    with pytest.raises(ValueError, match="x and y are both 'a'"):
        sweep_map(result, "a", "a", "sum")
    with pytest.raises(ValueError, match=r"shape \(2,\) per point, not one number"):
        sweep_map(result, "a", "b", "pair")
    with pytest.raises(TypeError, match="expected a SweepResult, got int"):
        sweep_map(3, "a", "b")
    cube = serial(lambda a, b, c: 1.0, {"a": [1, 2], "b": [1, 2], "c": [1, 2]})
    with pytest.raises(ValueError, match="c varies too"):
        sweep_map(cube, "a", "b")


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"save: there is no folder .*nowhere'; make it first"):
        sweep(lambda a: a, {"a": [1]}, executor="serial", save=tmp_path / "nowhere" / "x", progress=False)
    with pytest.raises(ValueError, match="is a folder; name a file in it"):
        sweep(lambda a: a, {"a": [1]}, executor="serial", save=tmp_path, progress=False)
