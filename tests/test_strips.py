from threading import Event

import numpy as np
import pytest

from stereohdr.stage_log import StageLog
from stereohdr.strips import available_threads, run_strips, run_together


@pytest.mark.parametrize("threads", [None, 1, 2, 9])
@pytest.mark.parametrize(("rows", "strip_rows"), [(1, 5), (10, 3), (9, 3), (0, 4)])
def test_every_row_is_done_once(threads, rows, strip_rows):
    done = np.zeros(rows, dtype=int)

    def task(start, stop):
        assert 0 < stop - start <= strip_rows
        done[start:stop] += 1

    run_strips(task, rows, strip_rows=strip_rows, threads=threads)
    assert (done == 1).all()
    assert available_threads() >= 1


def test_an_error_in_a_strip_comes_out():
    def task(start, stop):
        raise RuntimeError("strip")

    for threads in (1, 2):
        with pytest.raises(RuntimeError, match="strip"):
            run_strips(task, 4, strip_rows=1, threads=threads)


@pytest.mark.parametrize("threads", [1, 2])
def test_tasks_run_together_and_answer_in_order(threads):
    reached = Event()
    seen, nothing, three = run_together(
        lambda: reached.wait(10 * (threads - 1)), reached.set, lambda: 3, threads=threads
    )
    assert (nothing, three) == (None, 3)
    assert seen == (threads == 2)
    assert run_together(threads=threads) == []


def test_an_error_in_a_task_comes_out():
    def task():
        raise RuntimeError("task")

    for threads in (1, 2):
        with pytest.raises(RuntimeError, match="task"):
            run_together(int, task, threads=threads)


def test_stage_log_keeps_arrays_only_when_asked():
    seen = []
    for keep in (False, True):
        log = StageLog(progress=seen.append, keep_arrays=keep)
        with log.stage("one"):
            log.keep(a=np.zeros(1))
        assert list(log.seconds) == ["one"]
        assert list(log.arrays) == (["a"] if keep else [])
    assert seen == ["one", "one"]
